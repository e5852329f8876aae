//! Pictures of a curved, rough body with all their truth: exact rays, reflectance laws, a Sun of finite size, cast shadows.

pub mod brdf;
pub mod error;
mod leaf;
pub mod path;
pub mod sun;
pub mod trace;
pub mod truth;
pub mod view;

pub use error::Error;
pub use sun::Sun;
pub use trace::{Hit, Interpolation, LocalSurface, SurfaceHit, Tracer};
pub use truth::{LightMaps, Shadows, Truth};
pub use view::View;
