//! What goes in.

use crate::relative_pose::JudgedMatch;
use crate::scale::Placement;
use crate::shading::Shaded;
use crate::{Prediction, View};

/// What the products are made of.
#[derive(Debug, Clone, Copy)]
pub struct ProductInput<'a> {
    /// Pictures and cameras of A and B; grey levels in `[0, 1]`, of the pointmaps' size.
    pub views: [&'a View; 2],
    /// Pose and pointmaps.
    pub prediction: &'a Prediction,
    /// Scale and place.
    pub placement: &'a Placement,
    /// Matches, where the method has any.
    pub matches: Option<&'a [JudgedMatch]>,
    /// The surface of shading, where the points are its.
    pub shaded: Option<&'a Shaded>,
}
