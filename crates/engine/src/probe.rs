//! A look at what passes between layers.

/// What has just been computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// A block of the encoder, for all images.
    EncoderBlock {
        /// Its index.
        idx: usize,
    },
    /// A block of both decoders, for all pairs.
    DecoderBlock {
        /// Its index.
        idx: usize,
    },
    /// The head of one view.
    Head {
        /// Which pair.
        pair: usize,
        /// Which of its views.
        view: usize,
    },
}

/// Receives progress and intermediates.
pub trait Probe {
    /// Whether [`Probe::see`] is wanted; without it nothing is computed or kept for the probe.
    fn wants_values(&self) -> bool {
        true
    }

    /// Called once for each intermediate, by the names of the network's parts (`enc_block3`, `dec1_block0`,
    /// `head2.act1` …).
    ///
    /// Tokens come as `[tokens, channels]`, maps as `[height, width, channels]`.
    fn see(&mut self, _name: &str, _shape: &[usize], _values: &[f32]) {}

    /// Called after each stage.
    fn finished(&mut self, _stage: Stage) {}
}

/// A probe or none.
pub(crate) struct Watch<'a>(pub Option<&'a mut dyn Probe>);

impl Watch<'_> {
    pub(crate) fn see(&mut self, name: impl FnOnce() -> String, shape: &[usize], values: &[f32]) {
        if let Some(probe) = self.0.as_deref_mut().filter(|probe| probe.wants_values()) {
            probe.see(&name(), shape, values);
        }
    }

    pub(crate) fn finished(&mut self, stage: Stage) {
        if let Some(probe) = self.0.as_deref_mut() {
            probe.finished(stage);
        }
    }

    pub(crate) fn wants_values(&self) -> bool {
        self.0.as_deref().is_some_and(Probe::wants_values)
    }
}
