//! The frame of a JPEG: its components and their blocks.

use super::entropy::CUT;

/// One component of the frame.
pub(super) struct Component {
    pub id: u8,
    pub across: usize,
    pub down: usize,
    /// Number of its table of steps.
    pub steps: usize,
    /// The level of its last block; differences are coded.
    pub level: i64,
    /// For each block the coefficients that are not 0 so far: bit k stands for coefficient k.
    pub nonzero: Vec<u64>,
    /// For each coefficient the bits still to come; `None` before its first scan.
    pub bits_left: [Option<u8>; 64],
    /// Blocks in a row of `nonzero`.
    pub stride: usize,
}

/// The frame that the scans fill.
pub(super) struct Frame {
    pub progressive: bool,
    /// Bits of a sample.
    pub bits: u8,
    pub width: usize,
    pub height: usize,
    pub components: Vec<Component>,
}

impl Frame {
    /// `None` where the height comes later.
    pub fn parse(body: &[u8], progressive: bool) -> Result<Option<Self>, String> {
        let [bits, h1, h0, w1, w0, count, rest @ ..] = body else { return Err(CUT.to_owned()) };
        let side = |high: u8, low: u8| usize::from(u16::from_be_bytes([high, low]));
        let (width, height) = (side(*w1, *w0), side(*h1, *h0));
        let described = rest.chunks_exact(3).take(usize::from(*count));
        let factors: Vec<(u8, usize, usize, usize)> = described
            .map(|c| (c[0], usize::from(c[1] >> 4), usize::from(c[1] & 15), usize::from(c[2])))
            .collect();
        if factors.len() != usize::from(*count)
            || factors.iter().any(|f| !(1..=4).contains(&f.1) || !(1..=4).contains(&f.2) || f.3 > 3)
        {
            return Err("a frame whose components cannot be".to_owned());
        }
        let mut frame = Self { progressive, bits: *bits, width, height, components: Vec::new() };
        frame.components = factors
            .into_iter()
            .map(|(id, across, down, steps)| Component {
                id,
                across,
                down,
                steps,
                level: 0,
                nonzero: Vec::new(),
                bits_left: [None; 64],
                stride: 0,
            })
            .collect();
        let [mcus_across, mcus_down] = frame.mcus();
        for component in &mut frame.components {
            component.stride = mcus_across * component.across;
            if progressive {
                component.nonzero = vec![0; component.stride * mcus_down * component.down];
            }
        }
        Ok((width > 0 && height > 0 && *count > 0).then_some(frame))
    }

    fn largest(&self) -> [usize; 2] {
        let most = |of: fn(&Component) -> usize| self.components.iter().map(of).max().unwrap_or(1);
        [most(|c| c.across), most(|c| c.down)]
    }

    /// Units of a scan of several components, across and down.
    pub fn mcus(&self) -> [usize; 2] {
        let [across, down] = self.largest();
        [self.width.div_ceil(8 * across), self.height.div_ceil(8 * down)]
    }

    /// Blocks of one component that hold samples, across and down.
    pub fn blocks(&self, idx: usize) -> [usize; 2] {
        let ([across, down], component) = (self.largest(), &self.components[idx]);
        let blocks = |side: usize, own: usize, most: usize| (side * own).div_ceil(most).div_ceil(8);
        [blocks(self.width, component.across, across), blocks(self.height, component.down, down)]
    }

    /// Every bit of every coefficient: the standard lets an encoder leave some out, but whole files that do are unheard of,
    /// and those that end between two scans are not.
    pub fn complete(&self) -> Result<(), String> {
        match self.components.iter().position(|c| c.bits_left.iter().any(|bits| *bits != Some(0))) {
            Some(idx) => Err(format!("scans of component {} are missing", idx + 1)),
            None => Ok(()),
        }
    }
}
