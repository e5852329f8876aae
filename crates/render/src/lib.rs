//! Pictures of a curved, rough body with all their truth: exact rays, reflectance laws, a Sun of finite size, cast shadows.

pub mod brdf;
mod dispatch;
mod error;
mod film;
mod horizon;
mod job;
mod kernel;
mod leaf;
mod march;
mod nodes;
mod path;
mod pattern;
mod radiance;
mod rays;
mod settings;
mod shade;
mod shadow;
mod simd;
pub mod sun;
mod tile;
mod trace;
mod truth;
mod viewpoint;

pub use error::Error;
pub use film::{Exposure, Tone};
pub use radiance::radiance;
pub use settings::{Albedo, AlbedoMap, InstructionSet, RadianceSettings, Shadows};
pub use sun::Sun;
pub use trace::{Hit, Interpolation, LocalSurface, SurfaceHit, Tracer};
pub use truth::{LightMaps, Truth};
pub use viewpoint::Viewpoint;
