//! The coordinate frames, as types that cannot be mixed up.

/// A right-handed Cartesian frame in metres.
pub trait Frame {
    /// The name used in files and messages.
    const NAME: &'static str;
}

macro_rules! frame {
    ($(#[$doc:meta])* $name:ident, $text:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name {
            const NAME: &'static str = $text;
        }
    };
}

frame!(
    /// The body's own rotating frame: origin at the centre, Z through the north pole, X at longitude 0.
    /// For the Moon this is the mean Earth/polar axis frame (Moon ME); [`crate::Body::frame`] names it in files.
    BodyFixed,
    "body_fixed"
);
frame!(
    /// East, north, up at a site on the sphere.
    Enu,
    "enu"
);
frame!(
    /// A camera: X right, Y down, Z forward (OpenCV axes), origin at the centre of projection.
    Cam,
    "cam"
);
frame!(
    /// The first camera of a pair.
    CamA,
    "cam_a"
);
frame!(
    /// The second camera of a pair.
    CamB,
    "cam_b"
);
frame!(
    /// The axes and origin of camera A in a prediction's own unit of length: a baseline, or whatever a network chose.
    /// Only a [`crate::Sim3`] leads out of it.
    PredA,
    "pred_a"
);
