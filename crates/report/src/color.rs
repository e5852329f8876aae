//! Colours that mean something, and colours that only tell series apart.

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// The truth, in profiles. This and the next are told apart without red and green, on white and on black.
pub(crate) const TRUTH: Rgb = [0, 114, 178];
/// A prediction, in profiles.
pub const PREDICTION: Rgb = [213, 94, 0];
/// Points of view 1, matches that are refused.
pub const VIEW_1: Rgb = [230, 120, 0];
/// Points of view 2, matches that agree.
pub const VIEW_2: Rgb = [0, 114, 178];
/// Rules, ideals, whatever stays in the background.
pub(crate) const QUIET: Rgb = [130, 130, 138];

/// Colours that the colour-blind can tell apart, after Okabe and Ito 2008, black left out.
const SERIES: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [120, 94, 60],
];

/// Colour of series number `index`.
pub fn series(index: usize) -> Rgb {
    SERIES[index % SERIES.len()]
}

/// As `#rrggbb`.
pub(crate) fn hex([red, green, blue]: Rgb) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}
