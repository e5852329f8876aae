//! A pair on its way from a source to the loader.

use crate::Error;
use crate::augment::{Augmentation, UndevelopedView};
use crate::correspondence::MatchRule;
use crate::covisibility::Sight;

/// What decides how a pair is fetched.
pub(super) struct Request<'a> {
    pub augmentation: &'a Augmentation,
    pub match_rule: MatchRule,
    pub size: [usize; 2],
    pub seed: u64,
    pub position: u64,
}

/// A pair on its way.
pub(super) struct Fetched {
    pub pair_id: u64,
    pub lights: [usize; 2],
    pub views: [UndevelopedView; 2],
    /// Whether depth was read; poses may be known without.
    pub has_depth: bool,
    /// What the terrain says each view sees of the other, for views that already have their final shape.
    pub sights: Option<[Vec<Sight>; 2]>,
    pub is_shaped: bool,
}

/// A pair that cannot be used.
pub(super) fn unusable(what: impl Into<String>, why: impl Into<String>) -> Error {
    Error::Unusable { what: what.into(), why: why.into() }
}
