//! COLMAP's camera models, by name and number.
//!
//! # Source
//! COLMAP's documentation, "Camera models"; the numbers are those of its binary files.

/// A model: its name, its number in binary files and how many parameters it has.
#[derive(Debug, PartialEq)]
pub(crate) struct Model {
    pub name: &'static str,
    pub id: i32,
    pub num_params: usize,
}

/// An ideal pinhole: `fx fy cx cy`.
pub(crate) const PINHOLE: Model = model("PINHOLE", 1, 4);
/// `fx fy cx cy k1 k2 p1 p2`.
pub(crate) const OPENCV: Model = model("OPENCV", 4, 8);
/// `fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6`.
pub(crate) const FULL_OPENCV: Model = model("FULL_OPENCV", 6, 12);

/// All of them; those that a pinhole with Brown's lens does not hold are refused by name.
pub(crate) static MODELS: [Model; 18] = [
    model("SIMPLE_PINHOLE", 0, 3),
    PINHOLE,
    model("SIMPLE_RADIAL", 2, 4),
    model("RADIAL", 3, 5),
    OPENCV,
    model("OPENCV_FISHEYE", 5, 8),
    FULL_OPENCV,
    model("FOV", 7, 5),
    model("SIMPLE_RADIAL_FISHEYE", 8, 4),
    model("RADIAL_FISHEYE", 9, 5),
    model("THIN_PRISM_FISHEYE", 10, 12),
    model("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16),
    model("SIMPLE_DIVISION", 12, 4),
    model("DIVISION", 13, 5),
    model("SIMPLE_FISHEYE", 14, 3),
    model("FISHEYE", 15, 4),
    model("EUCM", 16, 6),
    model("EQUIRECTANGULAR", 17, 2),
];

const fn model(name: &'static str, id: i32, num_params: usize) -> Model {
    Model { name, id, num_params }
}
