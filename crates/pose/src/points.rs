//! Matches laid out for loops: one array per coordinate, padded to whole vectors.

use selenograph_geometry::Vector3;

/// Matches that one pass of the vector loops takes together.
pub const LANES: usize = 8;

/// Coordinates of pairs on the planes `z = 1`, padded to a multiple of eight with values that are not numbers.
#[derive(Debug, Clone, Default)]
pub struct Pairs {
    /// First coordinate in A.
    pub ax: Vec<f64>,
    /// Second coordinate in A.
    pub ay: Vec<f64>,
    /// First coordinate in B.
    pub bx: Vec<f64>,
    /// Second coordinate in B.
    pub by: Vec<f64>,
    len: usize,
}

impl Pairs {
    /// Of pairs `[ax, ay, bx, by]`.
    pub fn new(pairs: impl IntoIterator<Item = [f64; 4]>) -> Self {
        let mut all = Self::default();
        all.refill(pairs);
        all
    }

    /// Replaces the content, keeping the memory.
    pub(crate) fn refill(&mut self, pairs: impl IntoIterator<Item = [f64; 4]>) {
        for column in [&mut self.ax, &mut self.ay, &mut self.bx, &mut self.by] {
            column.clear();
        }
        for [ax, ay, bx, by] in pairs {
            self.ax.push(ax);
            self.ay.push(ay);
            self.bx.push(bx);
            self.by.push(by);
        }
        self.len = self.ax.len();
        let padded = self.len.next_multiple_of(LANES);
        for column in [&mut self.ax, &mut self.ay, &mut self.bx, &mut self.by] {
            column.resize(padded, f64::NAN);
        }
    }

    /// Number of pairs, without the padding.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True where there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of pairs with the padding.
    pub(crate) fn padded_len(&self) -> usize {
        self.ax.len()
    }

    /// One pair as an array.
    pub fn at(&self, i: usize) -> [f64; 4] {
        [self.ax[i], self.ay[i], self.bx[i], self.by[i]]
    }

    /// A point of A with its third coordinate 1.
    pub fn a(&self, i: usize) -> Vector3<f64> {
        Vector3::new(self.ax[i], self.ay[i], 1.0)
    }

    /// A point of B with its third coordinate 1.
    pub fn b(&self, i: usize) -> Vector3<f64> {
        Vector3::new(self.bx[i], self.by[i], 1.0)
    }
}

/// The same in f32, for counting: on the plane `z = 1` its rounding is a ten-thousandth of a pixel.
#[derive(Debug, Clone)]
pub struct PairsF32 {
    /// First coordinate in A.
    pub ax: Vec<f32>,
    /// Second coordinate in A.
    pub ay: Vec<f32>,
    /// First coordinate in B.
    pub bx: Vec<f32>,
    /// Second coordinate in B.
    pub by: Vec<f32>,
}

impl From<&Pairs> for PairsF32 {
    fn from(pairs: &Pairs) -> Self {
        let narrow = |column: &[f64]| column.iter().map(|v| *v as f32).collect();
        Self { ax: narrow(&pairs.ax), ay: narrow(&pairs.ay), bx: narrow(&pairs.bx), by: narrow(&pairs.by) }
    }
}
