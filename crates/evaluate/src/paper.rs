//! Numbers that others have published, shown beside ours and never mixed with them.

/// A published row for one trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Published {
    /// Class of items, as the breakdown by trajectory names it.
    pub class: &'static str,
    /// Whose numbers.
    pub name: &'static str,
    /// Column heading and value in the column's unit.
    pub values: &'static [(&'static str, f64)],
}

/// Chamfer (m), correlation of slopes, SSIM, profile error (m) and correlation, before and after fine-tuning.
///
/// # Source
/// StereoLunar (ICCV 2025), table 3.
pub const TERRAIN: [Published; 6] = [
    published(
        "nadir",
        "paper: MASt3R",
        &[
            ("Chamfer", 236.0),
            ("slope corr.", 0.21),
            ("SSIM", 0.31),
            ("profile MAE", 218.5),
            ("profile corr.", 0.76),
        ],
    ),
    published(
        "nadir",
        "paper: fine-tuned",
        &[
            ("Chamfer", 100.0),
            ("slope corr.", 0.80),
            ("SSIM", 0.78),
            ("profile MAE", 46.8),
            ("profile corr.", 0.97),
        ],
    ),
    published(
        "oblique",
        "paper: MASt3R",
        &[
            ("Chamfer", 322.0),
            ("slope corr.", 0.39),
            ("SSIM", 0.51),
            ("profile MAE", 197.8),
            ("profile corr.", 0.88),
        ],
    ),
    published(
        "oblique",
        "paper: fine-tuned",
        &[
            ("Chamfer", 144.0),
            ("slope corr.", 0.82),
            ("SSIM", 0.83),
            ("profile MAE", 57.7),
            ("profile corr.", 0.99),
        ],
    ),
    published(
        "dynamic",
        "paper: MASt3R",
        &[
            ("Chamfer", 279.0),
            ("slope corr.", 0.09),
            ("SSIM", 0.24),
            ("profile MAE", 229.4),
            ("profile corr.", 0.63),
        ],
    ),
    published(
        "dynamic",
        "paper: fine-tuned",
        &[
            ("Chamfer", 111.0),
            ("slope corr.", 0.76),
            ("SSIM", 0.76),
            ("profile MAE", 57.8),
            ("profile corr.", 0.95),
        ],
    ),
];

const fn published(
    class: &'static str,
    name: &'static str,
    values: &'static [(&'static str, f64)],
) -> Published {
    Published { class, name, values }
}
