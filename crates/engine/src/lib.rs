//! The network on CPUs, in f32: packed weights, fused attention, direct convolutions.
