//! Matches as text: a table of two pixel positions a line, of any matcher, and ours for others.

use crate::matching::{Grain, Match};
use crate::relative_pose::{FEATURE_NOISE_PX, JudgedMatch};
use crate::{Error, input_file};
use selenograph_geometry::{PixelConvention, Point2};
use std::fmt::Write as _;
use std::path::Path;

/// Columns of the table; the score may be missing.
const COLUMNS: [&str; 5] = ["a_x", "a_y", "b_x", "b_y", "score"];

/// Matches that were given, and how fine they are.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenMatches {
    /// Pixels from the pictures' corners.
    pub matches: Vec<Match>,
    /// How fine they are.
    pub grain: Grain,
}

impl GivenMatches {
    /// Matches of unknown making. How fine they are is read off from their positions in B, which the matcher found: all of them lie a
    /// multiple of some step apart if they were rounded to it (whole pixels, pixels of a smaller picture). They are taken to be
    /// right to the rounding of that step, and never better than features, 0.1 px: what all matches share shows in no residual.
    pub fn new(matches: Vec<Match>) -> Self {
        let step = |axis: fn(&Match) -> f64| step_of(matches.iter().map(axis));
        let step_px = step(|m| m.b.x).max(step(|m| m.b.y));
        let rounded = Grain::of_pixels(step_px, 0.0);
        let grain = Grain {
            match_px: step_px.max(1.0),
            noise_px: rounded.noise_px.max(FEATURE_NOISE_PX),
            patch_px: 0.0,
        };
        Self { matches, grain }
    }

    /// Reads a table: `a_x,a_y,b_x,b_y[,score]`, with these names in a first line or, without one, in this order. Commas, semicolons,
    /// tabs or spaces part them; other named columns are left aside, lines that begin with `#` too.
    ///
    /// # Shapes and units
    /// Pixels of the pictures as they are stored, of the stated convention; a higher score is better, and only the order counts.
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for what is no such table, no match, and places outside the pictures (columns and rows
    /// in `sizes`).
    pub fn read(path: &Path, sizes: [[usize; 2]; 2], convention: PixelConvention) -> Result<Self, Error> {
        let text = input_file::read_text(path)?;
        let table = Table { path, sizes, offset: convention.to_corner_offset() };
        Ok(Self::new(table.parse(&text)?))
    }

    /// How many, and what is taken of their making.
    pub fn sentence(&self) -> String {
        let Grain { match_px, noise_px, .. } = self.grain;
        let places = if noise_px > FEATURE_NOISE_PX {
            format!("rounded to {match_px:.3} px")
        } else {
            "told to fractions of a pixel".to_owned()
        };
        format!("{} matches, places {places}: taken as right to {noise_px:.2} px at best", self.matches.len())
    }
}

/// The step that numbers lie a multiple of apart; 0 where they show none.
fn step_of(numbers: impl Iterator<Item = f64>) -> f64 {
    /// Closer numbers differ by the digits of a table.
    const SAME: f64 = 0.01;
    /// Steps below this do not matter, and fewer numbers show none.
    const SMALLEST: f64 = 0.05;
    const FEWEST: usize = 8;
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers.dedup_by(|b, a| *b - *a < SAME);
    let gaps = numbers.windows(2).map(|pair| pair[1] - pair[0]);
    let gap = gaps.fold(f64::INFINITY, f64::min);
    if numbers.len() < FEWEST || gap < SMALLEST {
        return 0.0;
    }
    // Scattered numbers may have no two neighbours among them.
    (1..=4).find_map(|share| lattice(&numbers, gap / f64::from(share))).unwrap_or(0.0)
}

/// The step near this one that all sorted numbers lie a multiple of apart.
fn lattice(numbers: &[f64], mut step: f64) -> Option<f64> {
    let first = numbers.first()?;
    for number in &numbers[1..] {
        let count = ((number - first) / step).round();
        if (number - first - count * step).abs() > 0.1 * step {
            return None;
        }
        // The farther, the surer.
        step = (number - first) / count;
    }
    Some(step)
}

/// A table being read.
struct Table<'a> {
    path: &'a Path,
    sizes: [[usize; 2]; 2],
    /// What leads from its pixels to ours.
    offset: f64,
}

impl Table<'_> {
    fn bad(&self, expected: impl Into<String>, found: impl Into<String>) -> Error {
        Error::Format { path: self.path.to_owned(), expected: expected.into(), found: found.into() }
    }

    fn parse(&self, text: &str) -> Result<Vec<Match>, Error> {
        let is_data =
            |(_, line): &(usize, &str)| !line.trim().is_empty() && !line.trim_start().starts_with('#');
        let mut lines = text.lines().enumerate().filter(is_data).peekable();
        let first = cells(lines.peek().map_or("", |(_, line)| line));
        let columns = if first.iter().all(|cell| cell.parse::<f64>().is_ok()) {
            if !matches!(first.len(), 4 | 5) {
                return Err(
                    self.bad("matches as a_x,a_y,b_x,b_y[,score]", format!("{} columns", first.len()))
                );
            }
            [Some(0), Some(1), Some(2), Some(3), (first.len() == 5).then_some(4)]
        } else {
            lines.next();
            COLUMNS.map(|name| first.iter().position(|cell| cell.eq_ignore_ascii_case(name)))
        };
        let [Some(a_x), Some(a_y), Some(b_x), Some(b_y), score] = columns else {
            return Err(self.bad("matches with columns a_x, a_y, b_x, b_y", format!("`{}`", first.join(","))));
        };
        let mut matches = Vec::new();
        for (idx, line) in lines {
            let cells = cells(line);
            let number = |column: usize| {
                let cell = cells.get(column).copied().unwrap_or_default();
                let number = cell.parse::<f64>().ok().filter(|v| v.is_finite());
                number.ok_or_else(|| self.bad("numbers", format!("`{cell}` in line {}", idx + 1)))
            };
            let a = self.place(0, [number(a_x)?, number(a_y)?], idx + 1)?;
            let b = self.place(1, [number(b_x)?, number(b_y)?], idx + 1)?;
            matches.push(Match { a, b, score: score.map_or(Ok(0.0), number)? });
        }
        if matches.is_empty() { Err(self.bad("matches", "none")) } else { Ok(matches) }
    }

    fn place(&self, view: usize, at: [f64; 2], line: usize) -> Result<Point2<f64>, Error> {
        let [width, height] = self.sizes[view];
        let [x, y] = at.map(|v| v + self.offset);
        if (0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y) {
            return Ok(Point2::new(x, y));
        }
        let expected = format!("pixels inside picture {} of {width}×{height}", ["A", "B"][view]);
        Err(self.bad(expected, format!("{}, {} in line {line}", at[0], at[1])))
    }
}

fn cells(line: &str) -> Vec<&str> {
    let parted: Vec<&str> = match [',', ';'].into_iter().find(|mark| line.contains(*mark)) {
        Some(mark) => line.split(mark).collect(),
        None => line.split_whitespace().collect(),
    };
    parted.into_iter().map(|cell| cell.trim().trim_matches('"')).collect()
}

/// Higher is better: the surest windows first.
pub(crate) fn score(m: &JudgedMatch) -> f64 {
    m.sigma_px.map_or(0.0, |sigma| -sigma)
}

/// Judged matches as a table that [`GivenMatches::read`] reads: pixels from the corner, and whether each agrees with the pose.
pub(crate) fn encode(matches: &[JudgedMatch]) -> String {
    let mut text = String::from("a_x,a_y,b_x,b_y,score,inlier\n");
    for m in matches {
        let inlier = u8::from(m.inlier);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{},{},{},{},{inlier}", m.a.x, m.a.y, m.b.x, m.b.y, score(m));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, convention: PixelConvention) -> Result<GivenMatches, Error> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("matches.csv");
        std::fs::write(&path, text).unwrap();
        GivenMatches::read(&path, [[100, 50], [80, 60]], convention)
    }

    #[test]
    fn tables_with_and_without_names() {
        let wanted = Match { a: Point2::new(10.5, 20.25), b: Point2::new(30.0, 40.75), score: 0.5 };
        for text in [
            "a_x,a_y,b_x,b_y,score\n10.5,20.25,30,40.75,0.5\n",
            "# a matcher\r\n10.5,20.25,30,40.75,0.5\r\n\r\n",
            "10.5 20.25\t30 40.75 0.5",
            "score;id;B_X;B_Y;A_X;A_Y\n0.5;x;30;40.75;10.5;20.25\n",
            "\u{feff}\"a_x\",\"a_y\",\"b_x\",\"b_y\",\"score\"\n10.5, 20.25, 30, 40.75, 0.5",
        ] {
            assert_eq!(read(text, PixelConvention::Corner).unwrap().matches, [wanted], "{text}");
        }
        let centre = read("10,19.75,29.5,40.25", PixelConvention::Center).unwrap().matches[0];
        assert_eq!(centre, Match { score: 0.0, ..wanted });
    }

    #[test]
    fn what_is_no_table_is_refused_with_its_line() {
        for (text, word) in [
            ("", "columns"),
            ("a_x,a_y,b_x,b_y\n", "none"),
            ("x1,y1,x2,y2\n1,2,3,4\n", "x1,y1"),
            ("1,2,3\n", "3 columns"),
            ("1,2,3,4\n1,2,three,4\n", "`three` in line 2"),
            ("1,2,3,4\n1,2,nan,4\n", "line 2"),
            ("1,2,3,4\n1,2,3\n", "line 2"),
            ("1,2,3,4\n101,2,3,4\n", "100×50"),
            ("1,2,3,4\n1,2,3,60.5\n", "80×60"),
            ("1,2,3,4\n-0.1,2,3,4\n", "line 2"),
        ] {
            let error = read(text, PixelConvention::Corner).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("matches.csv"), "{text:?}: {error}");
        }
    }

    #[test]
    fn how_fine_they_are_is_read_off() {
        let of = |step: f64, offset: f64| {
            let place = |k: usize| {
                Point2::new(offset + step * (k * 37 % 101) as f64, offset + step * (k * 53 % 89) as f64)
            };
            let digits = |v: f64| (v * 1000.0).round() / 1000.0;
            let matches = (0..60).map(|k| {
                let b = place(k);
                Match {
                    a: Point2::new(k as f64 * 0.37, 2.0),
                    b: Point2::new(digits(b.x), digits(b.y)),
                    score: 0.0,
                }
            });
            GivenMatches::new(matches.collect()).grain
        };
        let near = |grain: Grain, [match_px, noise_px]: [f64; 2]| {
            assert!(
                (grain.match_px - match_px).abs() < 0.03 && (grain.noise_px - noise_px).abs() < 0.01,
                "{grain:?}"
            );
        };
        near(of(1.0, 0.5), [1.0, 0.29]);
        near(of(1.0, 0.0), [1.0, 0.29]);
        near(of(1.6, 0.8), [1.6, 0.46]);
        near(of(8.0 / 3.0, 0.0), [8.0 / 3.0, 0.77]);
        near(of(0.5, 0.0), [1.0, 0.145]);
        near(of(0.0731, 0.0), [1.0, 0.1]);
    }

    #[test]
    fn ours_are_read_back() {
        let judged = [
            JudgedMatch {
                sigma_px: Some(0.02),
                inlier: true,
                residual_px: 0.1,
                ..JudgedMatch::unjudged(Point2::new(1.0 / 3.0, 2.0), Point2::new(3.5, 4.1))
            },
            JudgedMatch::unjudged(Point2::new(5.0, 6.0), Point2::new(7.0, 8.0)),
        ];
        let back = read(&encode(&judged), PixelConvention::Corner).unwrap().matches;
        assert_eq!(back.iter().map(|m| (m.a, m.b)).collect::<Vec<_>>(), judged.map(|m| (m.a, m.b)));
        assert_eq!(back[0].score, -0.02);
    }
}
