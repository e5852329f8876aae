//! A small TIFF writer for tests: any sample type, compression and layout, written independently of the reader.

use std::io::Write;
use std::path::Path;

/// Byte order of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    Little,
    Big,
}

/// Values of a tag.
#[derive(Debug, Clone)]
pub enum Values {
    Shorts(Vec<u16>),
    Longs(Vec<u64>),
    Doubles(Vec<f64>),
    Text(String),
}

/// A TIFF of one image: `samples[band][row][column]`, as numbers of `kind`.
#[derive(Debug, Clone)]
pub struct TinyTiff {
    pub big: bool,
    pub order: Order,
    pub kind: &'static str,
    pub compression: u16,
    pub predictor: u16,
    /// Tile size, or rows per strip with width 0.
    pub chunk: (usize, usize),
    pub planar: bool,
    pub samples: Vec<Vec<Vec<f64>>>,
    pub tags: Vec<(u16, Values)>,
}

/// In place of 5 as the compression of a [`TinyTiff`]: LZW of before 1993, which files call 5 too.
pub const OLD_LZW: u16 = 50_005;

/// LZW of before 1993 as libtiff's `LZWDecodeCompat` takes it, in which every byte is a code of its own: least significant bit
/// first, and a code is a bit longer from the one on at which the table has outgrown the length before.
fn old_lzw(bytes: &[u8]) -> Vec<u8> {
    const CLEAR: u16 = 256;
    const END: u16 = 257;
    let (mut out, mut held, mut count) = (Vec::new(), 0u32, 0);
    let (mut next, mut length) = (END, 9);
    let codes = bytes.iter().map(|byte| u16::from(*byte));
    for code in std::iter::once(CLEAR).chain(codes).chain([END]) {
        held |= u32::from(code) << count;
        count += length;
        while count >= 8 {
            out.push(held as u8);
            (held, count) = (held >> 8, count - 8);
        }
        // Each code but the first after a clearing one makes an entry.
        if code != CLEAR {
            next += 1;
            length += u32::from(next >> length);
        }
    }
    out.push(held as u8);
    out
}

pub const SOUTH_KEYS: &[(u16, f64)] =
    &[(1024, 1.0), (3075, 15.0), (3081, -90.0), (3092, 1.0), (3095, 0.0), (2057, 1_737_400.0)];

/// GeoKey tags: the codes (1024…, 3072, 3075, 3076) as shorts, everything else as doubles.
pub fn geo_keys(keys: &[(u16, f64)]) -> Vec<(u16, Values)> {
    let mut keys = keys.to_vec();
    keys.sort_by_key(|k| k.0);
    let mut directory = vec![1, 1, 0, keys.len() as u16];
    let mut doubles = Vec::new();
    for (key, value) in keys {
        if matches!(key, 1024 | 1025 | 2048 | 2051 | 2052 | 2054 | 4099 | 3072 | 3074 | 3075 | 3076) {
            directory.extend([key, 0, 1, value as u16]);
        } else {
            directory.extend([key, 34736, 1, doubles.len() as u16]);
            doubles.push(value);
        }
    }
    vec![(34735, Values::Shorts(directory)), (34736, Values::Doubles(doubles))]
}

/// Pixel scale and a tiepoint at the first corner.
pub fn transform(x: f64, y: f64, step: f64) -> Vec<(u16, Values)> {
    vec![
        (33550, Values::Doubles(vec![step, step, 0.0])),
        (33922, Values::Doubles(vec![0.0, 0.0, 0.0, x, y, 0.0])),
    ]
}

impl TinyTiff {
    /// Uncompressed single-band strips with the south polar map of the Moon, 5 m, first corner at (1000, 2000).
    pub fn new(
        kind: &'static str,
        width: usize,
        height: usize,
        value: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let mut tags = geo_keys(SOUTH_KEYS);
        tags.extend(transform(1000.0, 2000.0, 5.0));
        let band = (0..height).map(|y| (0..width).map(|x| value(0, x, y)).collect()).collect();
        Self {
            big: false,
            order: Order::Little,
            kind,
            compression: 1,
            predictor: 1,
            chunk: (0, 3),
            planar: false,
            samples: vec![band],
            tags,
        }
    }

    fn size(&self) -> usize {
        self.kind[1..].parse::<usize>().unwrap() / 8
    }

    fn sample(&self, v: f64) -> Vec<u8> {
        let mut bytes = match self.kind {
            "u8" => (v as u8).to_le_bytes().to_vec(),
            "i8" => (v as i8).to_le_bytes().to_vec(),
            "u16" => (v as u16).to_le_bytes().to_vec(),
            "i16" => (v as i16).to_le_bytes().to_vec(),
            "u32" => (v as u32).to_le_bytes().to_vec(),
            "i32" => (v as i32).to_le_bytes().to_vec(),
            "f32" => (v as f32).to_le_bytes().to_vec(),
            _ => v.to_le_bytes().to_vec(),
        };
        if self.order == Order::Big {
            bytes.reverse();
        }
        bytes
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        let fold = |sum: u64, b: &u8| (sum << 8) | u64::from(*b);
        match self.order {
            Order::Big => bytes.iter().fold(0, fold),
            Order::Little => bytes.iter().rev().fold(0, fold),
        }
    }

    fn bytes(&self, value: u64, size: usize) -> Vec<u8> {
        match self.order {
            Order::Big => value.to_be_bytes()[8 - size..].to_vec(),
            Order::Little => value.to_le_bytes()[..size].to_vec(),
        }
    }

    /// One row of a chunk after the predictor.
    fn predicted(&self, row: &[Vec<u8>], interleaved: usize) -> Vec<u8> {
        let size = self.size();
        match self.predictor {
            2 => (0..row.len())
                .flat_map(|i| {
                    let before = if i < interleaved { 0 } else { self.number(&row[i - interleaved]) };
                    self.bytes(self.number(&row[i]).wrapping_sub(before), size)
                })
                .collect(),
            3 => {
                let mut planes = Vec::new();
                for b in 0..size {
                    for sample in row {
                        planes.push(if self.order == Order::Big { sample[b] } else { sample[size - 1 - b] });
                    }
                }
                let before = |i: usize| if i < interleaved { 0 } else { planes[i - interleaved] };
                (0..planes.len()).map(|i| planes[i].wrapping_sub(before(i))).collect()
            }
            _ => row.concat(),
        }
    }

    fn packed(&self, bytes: &[u8]) -> Vec<u8> {
        match self.compression {
            5 => {
                weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(bytes).unwrap()
            }
            OLD_LZW => old_lzw(bytes),
            8 | 32946 => {
                let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
            // Literal runs, and one run of equal bytes in front to have both kinds.
            32773 => {
                let equal = bytes.iter().take_while(|b| **b == bytes[0]).count().min(128);
                let mut out = if equal > 1 { vec![(257 - equal) as u8, bytes[0]] } else { Vec::new() };
                for run in bytes[if equal > 1 { equal } else { 0 }..].chunks(128) {
                    out.push(run.len() as u8 - 1);
                    out.extend(run);
                }
                out
            }
            _ => bytes.to_vec(),
        }
    }

    fn chunks(&self) -> Vec<Vec<u8>> {
        let (height, width) = (self.samples[0].len(), self.samples[0][0].len());
        let (chunk_width, chunk_height) = if self.chunk.0 == 0 { (width, self.chunk.1) } else { self.chunk };
        let planes: Vec<Vec<usize>> = if self.planar {
            (0..self.samples.len()).map(|b| vec![b]).collect()
        } else {
            vec![(0..self.samples.len()).collect()]
        };
        let mut chunks = Vec::new();
        for bands in planes {
            for top in (0..height).step_by(chunk_height) {
                for left in (0..width).step_by(chunk_width) {
                    let rows = if self.chunk.0 == 0 { chunk_height.min(height - top) } else { chunk_height };
                    let mut bytes = Vec::new();
                    for y in top..top + rows {
                        let row: Vec<Vec<u8>> = (left..left + chunk_width)
                            .flat_map(|x| bands.iter().map(move |b| (x, b)))
                            .map(|(x, b)| {
                                self.samples[*b].get(y).and_then(|r| r.get(x)).copied().unwrap_or(77.0)
                            })
                            .map(|v| self.sample(v))
                            .collect();
                        bytes.extend(self.predicted(&row, bands.len()));
                    }
                    chunks.push(self.packed(&bytes));
                }
            }
        }
        chunks
    }

    /// The bytes of the file.
    pub fn encode(&self) -> Vec<u8> {
        let (height, width) = (self.samples[0].len(), self.samples[0][0].len());
        let field = if self.big { 8 } else { 4 };
        let mut out = if self.order == Order::Big { b"MM".to_vec() } else { b"II".to_vec() };
        out.extend(self.bytes(if self.big { 43 } else { 42 }, 2));
        if self.big {
            out.extend(self.bytes(8, 2));
            out.extend(self.bytes(0, 2));
        }
        let place = out.len();
        out.extend(vec![0; field]);
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for chunk in self.chunks() {
            offsets.push(out.len() as u64);
            counts.push(chunk.len() as u64);
            out.extend(chunk);
        }
        let bands = self.samples.len() as u16;
        let format = match &self.kind[..1] {
            "u" => 1,
            "i" => 2,
            _ => 3,
        };
        let short = |v: u16| Values::Shorts(vec![v]);
        let mut tags = self.tags.clone();
        tags.extend([
            (256, Values::Longs(vec![width as u64])),
            (257, Values::Longs(vec![height as u64])),
            (258, Values::Shorts(vec![self.size() as u16 * 8; bands.into()])),
            (259, short(if self.compression == OLD_LZW { 5 } else { self.compression })),
            (277, short(bands)),
            (284, short(if self.planar { 2 } else { 1 })),
            (317, short(self.predictor)),
            (339, Values::Shorts(vec![format; bands.into()])),
        ]);
        if tags.iter().all(|(number, _)| *number != 262) {
            tags.push((262, short(1)));
        }
        if self.chunk.0 == 0 {
            tags.push((278, Values::Longs(vec![self.chunk.1 as u64])));
            tags.extend([(273, Values::Longs(offsets)), (279, Values::Longs(counts))]);
        } else {
            tags.push((322, Values::Longs(vec![self.chunk.0 as u64])));
            tags.push((323, Values::Longs(vec![self.chunk.1 as u64])));
            tags.extend([(324, Values::Longs(offsets)), (325, Values::Longs(counts))]);
        }
        tags.sort_by_key(|t| t.0);
        let mut table = self.bytes(tags.len() as u64, if self.big { 8 } else { 2 });
        for (tag, values) in tags {
            let (kind, count, mut bytes) = match values {
                Values::Shorts(v) => {
                    (3, v.len(), v.iter().flat_map(|n| self.bytes(u64::from(*n), 2)).collect())
                }
                Values::Longs(v) if self.big => {
                    (16, v.len(), v.iter().flat_map(|n| self.bytes(*n, 8)).collect())
                }
                Values::Longs(v) => (4, v.len(), v.iter().flat_map(|n| self.bytes(*n, 4)).collect()),
                Values::Doubles(v) => {
                    (12, v.len(), v.iter().flat_map(|n| self.bytes(n.to_bits(), 8)).collect::<Vec<u8>>())
                }
                Values::Text(v) => (2, v.len() + 1, [v.as_bytes(), b"\0"].concat()),
            };
            if bytes.len() > field {
                let at = out.len() as u64;
                out.extend(&bytes);
                bytes = self.bytes(at, field);
            }
            bytes.resize(field, 0);
            table.extend(self.bytes(u64::from(tag), 2));
            table.extend(self.bytes(kind, 2));
            table.extend(self.bytes(count as u64, field));
            table.extend(bytes);
        }
        let at = self.bytes(out.len() as u64, field);
        out[place..place + field].copy_from_slice(&at);
        out.extend(table);
        out.extend(vec![0; field]);
        out
    }

    /// Writes the file.
    #[allow(dead_code, reason = "not every test binary writes files")]
    pub fn write(&self, path: &Path) {
        std::fs::write(path, self.encode()).unwrap();
    }
}
