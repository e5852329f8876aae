//! Pictures of a curved, rough body with all their truth: exact rays, reflectance laws, a Sun of finite size, cast shadows.

pub mod brdf;
mod dispatch;
pub mod error;
pub mod film;
mod horizon;
mod kernel;
mod leaf;
mod march;
pub mod path;
mod pattern;
pub mod radiance;
pub mod settings;
mod shade;
mod shadow;
mod simd;
pub mod sun;
mod tile;
pub mod trace;
pub mod truth;
pub mod view;

pub use error::Error;
pub use film::{Exposure, Tone};
pub use radiance::radiance;
pub use settings::{Albedo, AlbedoMap, InstructionSet, RadianceSettings};
pub use sun::Sun;
pub use trace::{Hit, Interpolation, LocalSurface, SurfaceHit, Tracer};
pub use truth::{LightMaps, Shadows, Truth};
pub use view::View;
