//! Small GeoTIFFs made by hand, so that each can lack or contradict one thing.

/// South polar stereographic on the Moon's sphere, user-defined, metres (GeoKeys as GDAL writes them).
const SOUTH_POLAR: [u16; 36] = [
    1, 1, 0, 8, // version, revision, number of keys
    1024, 0, 1, 1, // model type: projected
    1025, 0, 1, 1, // raster type: pixel is area
    2057, 34736, 1, 0, // semi-major axis
    2058, 34736, 1, 1, // semi-minor axis
    3074, 0, 1, 32767, // projection: user-defined
    3075, 0, 1, 15, // polar stereographic
    3081, 34736, 1, 2, // latitude of origin
    3095, 34736, 1, 3, // longitude that points up
];

/// Number of a tag; type, count and bytes of its values.
type Tag = (u16, (u16, usize, Vec<u8>));

/// What a test file holds.
pub struct Dem {
    pub width: usize,
    pub height: usize,
    pub heights: Vec<f32>,
    pub cell_m: f64,
    /// Of the sphere that the map lies on.
    pub radius_m: f64,
    pub georeferenced: bool,
    /// GeoTIFF code of the coordinate transformation (15: polar stereographic).
    pub transformation: u16,
    pub nodata: Option<&'static str>,
}

impl Dem {
    /// Gentle hills round the pole.
    pub fn hills(side: usize, cell_m: f64) -> Self {
        let wave = |i: usize| (i as f32 * 0.31).sin();
        let heights = (0..side * side).map(|k| 100.0 + 12.0 * wave(k % side) * wave(k / side + 3)).collect();
        Self {
            width: side,
            height: side,
            heights,
            cell_m,
            radius_m: 1_737_400.0,
            georeferenced: true,
            transformation: 15,
            nodata: None,
        }
    }

    pub fn flat(side: usize, height: f32) -> Self {
        Self { heights: vec![height; side * side], ..Self::hills(side, 20.0) }
    }

    /// The bytes of the file: classic TIFF, little-endian, one strip.
    pub fn bytes(&self) -> Vec<u8> {
        let half_m = self.cell_m * self.width as f64 / 2.0;
        let mut keys = SOUTH_POLAR.to_vec();
        keys[6 * 4 + 3] = self.transformation;
        let samples: Vec<u8> = self.heights.iter().flat_map(|h| h.to_le_bytes()).collect();
        let short =
            |values: &[u16]| (3u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect());
        let long = |value: usize| (4u16, 1, (value as u32).to_le_bytes().to_vec());
        let double =
            |values: &[f64]| (12u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect());
        let mut tags: Vec<Tag> = vec![
            (256, long(self.width)),
            (257, long(self.height)),
            (258, short(&[32])),
            (259, short(&[1])),
            (262, short(&[1])),
            (273, long(8)),
            (277, short(&[1])),
            (278, long(self.height)),
            (279, long(samples.len())),
            (339, short(&[3])),
        ];
        if self.georeferenced {
            tags.push((33550, double(&[self.cell_m, self.cell_m, 0.0])));
            tags.push((33922, double(&[0.0, 0.0, 0.0, -half_m, half_m, 0.0])));
            tags.push((34735, short(&keys)));
            tags.push((34736, double(&[self.radius_m, self.radius_m, -90.0, 0.0])));
        }
        if let Some(text) = self.nodata {
            let bytes: Vec<u8> = text.bytes().chain([0]).collect();
            tags.push((42113, (2, bytes.len(), bytes)));
        }
        assemble(&samples, &tags)
    }
}

fn assemble(samples: &[u8], tags: &[Tag]) -> Vec<u8> {
    let directory = 8 + samples.len();
    let mut overflow_at = directory + 2 + 12 * tags.len() + 4;
    let mut overflow: Vec<u8> = Vec::new();
    let mut out = b"II*\0".to_vec();
    out.extend((directory as u32).to_le_bytes());
    out.extend(samples);
    out.extend((tags.len() as u16).to_le_bytes());
    for (tag, (kind, count, bytes)) in tags {
        out.extend(tag.to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend((*count as u32).to_le_bytes());
        if bytes.len() <= 4 {
            let mut inline = bytes.clone();
            inline.resize(4, 0);
            out.extend(inline);
        } else {
            out.extend((overflow_at as u32).to_le_bytes());
            overflow.extend(bytes);
            overflow_at += bytes.len();
        }
    }
    out.extend([0; 4]);
    out.extend(overflow);
    out
}
