//! A terrain on disk: a folder with `terrain.json` and one binary file per layer, mapped when opened.
//!
//! A folder is written beside its target under another name and renamed when complete, so that a terrain that is there
//! is whole. Opening reads the description, the headers and the sizes, and checks that they belong together;
//! [`verify`] reads every byte.

use crate::layer_file::{self, LayerWriter, Section, Written};
use crate::{Error, Grid, Layer, Terrain};
use selenograph_files::{FolderDraft, FolderKind, checksum, regular};
use selenograph_geometry::{Body, proj_string};
use selenograph_raster::georef::Affine;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Version of the format written and read here.
pub const FORMAT_VERSION: u32 = 1;
/// The description's file name.
const DESCRIPTION: &str = "terrain.json";

/// A terrain's folder, as one that may be replaced by another.
pub static TERRAIN: FolderKind = FolderKind {
    command: "dem import",
    what: "a terrain",
    is_own: |folder| {
        let text = regular::read(&folder.join(DESCRIPTION), regular::MAX_TEXT_BYTES).unwrap_or_default();
        serde_json::from_slice::<VersionOnly>(&text).is_ok_and(|found| found.format == FORMAT)
    },
    names: &[DESCRIPTION, "layer-#.bin"],
    parts: &[],
};

/// Where a layer's heights come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// File name, or what made it.
    pub name: String,
    /// BLAKE3 of the source's bytes, hexadecimal, if it is a file.
    pub blake3: Option<String>,
    /// What else is known of it: the label of a file, the settings of a synthesis.
    pub details: serde_json::Value,
}

/// One layer as `terrain.json` describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerDescription {
    /// File in the folder.
    pub file: String,
    /// Its length, bytes.
    pub bytes: u64,
    /// Nodes along a row.
    pub cols: usize,
    /// Rows of nodes.
    pub rows: usize,
    /// The map, as a PROJ string.
    pub crs: String,
    /// Grid → map: `x = a0 + a1·c + a2·r`, `y = a3 + a4·c + a5·r`, node centres at integers.
    pub map_from_grid: Affine,
    /// Size of a cell at the middle, metres.
    pub cell_m: f64,
    /// Lowest and highest node, metres.
    pub height_range_m: [f32; 2],
    /// Absent nodes.
    pub num_absent: u64,
    /// Whether effective cell sizes are recorded.
    pub has_support: bool,
    /// Where the heights come from.
    pub source: Source,
    /// How the layer was fitted onto the coarser ones; absent for the coarsest.
    pub nest: Option<crate::nest::NestReport>,
    /// The parts of the file and their checksums.
    pub sections: Vec<Section>,
}

/// `terrain.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Always `selenograph terrain`.
    pub format: String,
    /// [`FORMAT_VERSION`].
    pub version: u32,
    /// The sphere.
    pub body: Body,
    /// Finest first.
    pub layers: Vec<LayerDescription>,
}

/// Only what every version has, to tell another version from a damaged file.
#[derive(Deserialize)]
struct VersionOnly {
    format: String,
    version: u32,
}

const FORMAT: &str = "selenograph terrain";

/// A terrain being written.
pub struct TerrainWriter {
    folder: FolderDraft,
    body: Body,
    /// In the order in which they came: coarse to fine.
    layers: Vec<(LayerDescription, Layer)>,
}

/// A layer being written.
pub struct NewLayer {
    writer: LayerWriter,
    file: String,
    grid: Grid,
    has_support: bool,
}

impl NewLayer {
    /// Takes whole rows of node heights, from the top.
    ///
    /// # Errors
    /// [`Error::Io`], for example when the disk is full.
    pub fn push_rows(&mut self, nodes: &[f32]) -> Result<(), Error> {
        self.writer.push_rows(nodes)
    }
}

impl TerrainWriter {
    /// Starts a terrain on a body; the folder appears when it is finished.
    pub fn create(folder: FolderDraft, body: Body) -> Self {
        Self { folder, body, layers: Vec::new() }
    }

    /// A folder for intermediate files that vanishes with the rest.
    pub(crate) fn scratch(&self) -> &Path {
        self.folder.path()
    }

    /// Starts the next finer layer. `has_support` announces effective cell sizes.
    ///
    /// # Errors
    /// [`Error::Geometry`] for another sphere, [`Error::Io`].
    pub fn begin_layer(&self, grid: &Grid, has_support: bool) -> Result<NewLayer, Error> {
        let idx = self.layers.len();
        grid.crs.body.same_sphere(format_args!("layer {idx}"), &self.body, "the terrain")?;
        let file = format!("layer-{idx}.bin");
        let writer = LayerWriter::create(&self.folder.path().join(&file), grid, has_support)?;
        Ok(NewLayer { writer, file, grid: grid.clone(), has_support })
    }

    /// Completes a layer; it can be read from then on.
    ///
    /// # Errors
    /// [`Error::AllAbsent`] without a single height; [`Error::Corrupt`] if rows are missing; [`Error::Io`].
    pub fn finish_layer(
        &mut self,
        layer: NewLayer,
        source: Source,
        support_m: Option<&[f32]>,
        nest: Option<crate::nest::NestReport>,
    ) -> Result<(), Error> {
        let NewLayer { writer, file, grid, has_support } = layer;
        let Written { sections, bytes, height_range, num_absent } =
            writer.finish(support_m).map_err(|error| match error {
                Error::AllAbsent { cells, .. } => Error::AllAbsent { name: source.name.clone(), cells },
                other => other,
            })?;
        let mapped = open_layer(&self.folder.path().join(&file), &grid, has_support, height_range)?;
        let description = LayerDescription {
            file,
            bytes,
            cols: grid.cols,
            rows: grid.rows,
            crs: proj_string::format(&grid.crs),
            map_from_grid: *grid.map_from_grid(),
            cell_m: grid.cell_m(),
            height_range_m: [height_range.0, height_range.1],
            num_absent,
            has_support,
            source,
            nest,
            sections,
        };
        self.layers.push((description, mapped));
        Ok(())
    }

    /// The layers finished so far as one surface.
    ///
    /// # Errors
    /// [`Error::Grid`] if they came in another order than coarse to fine.
    pub fn surface(&self) -> Result<Terrain, Error> {
        Terrain::new(self.body.clone(), self.layers.iter().rev().map(|(_, layer)| layer.clone()).collect())
    }

    /// Writes the description and moves the whole into place.
    ///
    /// # Errors
    /// [`Error::Grid`] without layers or out of order; [`Error::Files`]; [`Error::Io`].
    pub fn finish(self) -> Result<Description, Error> {
        self.surface()?;
        let description = Description {
            format: FORMAT.into(),
            version: FORMAT_VERSION,
            body: self.body,
            layers: self.layers.into_iter().rev().map(|(layer, _)| layer).collect(),
        };
        let path = self.folder.path().join(DESCRIPTION);
        let text = serde_json::to_vec_pretty(&description)
            .map_err(|e| Error::io("write", &path)(std::io::Error::other(e)))?;
        let hash = checksum::of_bytes(&text);
        for layer in &description.layers {
            layer_file::write_header(&self.folder.path().join(&layer.file), FORMAT_VERSION, &hash)?;
        }
        fs::write(&path, &text).map_err(Error::io("write", &path))?;
        File::open(&path).and_then(|f| f.sync_all()).map_err(Error::io("write", &path))?;
        self.folder.commit()?;
        Ok(description)
    }
}

fn open_layer(path: &Path, grid: &Grid, has_support: bool, height_range: (f32, f32)) -> Result<Layer, Error> {
    let layer_file::Mapped { heights, pyramid, support_m } = layer_file::map(path, grid, has_support)?;
    let cell_m = grid.cell_m();
    Ok(Layer { grid: grid.clone(), heights, pyramid, support_m, cell_m, height_range })
}

/// Reads `terrain.json` and its hash.
fn describe_with_hash(dir: &Path) -> Result<(Description, checksum::Checksum), Error> {
    let path = dir.join(DESCRIPTION);
    let text = regular::read(&path, regular::MAX_TEXT_BYTES).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory => Error::NotATerrain {
            path: dir.to_owned(),
            what: if dir.exists() {
                "it has no terrain.json".into()
            } else {
                "there is no such folder".into()
            },
        },
        _ => Error::io("read", &path)(source),
    })?;
    let damaged = |e: serde_json::Error| Error::NotATerrain {
        path: dir.to_owned(),
        what: format!("terrain.json: {e}"),
    };
    let VersionOnly { format, version } = serde_json::from_slice(&text).map_err(damaged)?;
    if format != FORMAT {
        return Err(Error::NotATerrain { path: dir.to_owned(), what: format!("its format is `{format}`") });
    }
    if version != FORMAT_VERSION {
        return Err(Error::Version { path: dir.to_owned(), expected: FORMAT_VERSION, found: version });
    }
    Ok((serde_json::from_slice(&text).map_err(damaged)?, checksum::of_bytes(&text)))
}

/// Reads what a terrain folder says of itself.
///
/// # Errors
/// [`Error::NotATerrain`], [`Error::Version`], [`Error::Io`].
pub fn describe(dir: &Path) -> Result<Description, Error> {
    Ok(describe_with_hash(dir)?.0)
}

impl Terrain {
    /// Maps a terrain folder. Reads the description, headers and sizes only.
    ///
    /// # Errors
    /// [`Error::NotATerrain`], [`Error::Version`], [`Error::Corrupt`] for a truncated file or one of another terrain,
    /// [`Error::Io`].
    pub fn open(dir: &Path) -> Result<Self, Error> {
        let (description, hash) = describe_with_hash(dir)?;
        let mut layers = Vec::new();
        for layer in &description.layers {
            let path = dir.join(&layer.file);
            let (version, belongs_to) = layer_file::read_header(&path)?;
            if version != FORMAT_VERSION {
                return Err(Error::Version { path, expected: FORMAT_VERSION, found: version });
            }
            if belongs_to != *hash.as_bytes() {
                return Err(Error::Corrupt {
                    path,
                    what: "header",
                    expected: "the checksum of this terrain.json".into(),
                    found: "another one".into(),
                });
            }
            let mut crs = proj_string::parse(&layer.crs).map_err(|e| Error::NotATerrain {
                path: dir.to_owned(),
                what: format!("layer `{}`: {e}", layer.file),
            })?;
            crs.body = description.body.clone();
            let grid = Grid::new(crs, layer.cols, layer.rows, layer.map_from_grid)?;
            let [low, high] = layer.height_range_m;
            layers.push(open_layer(&path, &grid, layer.has_support, (low, high))?);
        }
        Self::new(description.body, layers)
    }
}

/// Reads every byte of a terrain and compares the checksums.
///
/// # Errors
/// As [`Terrain::open`]; [`Error::Corrupt`] names the first file and part that differs.
pub fn verify(dir: &Path) -> Result<(), Error> {
    Terrain::open(dir)?;
    for layer in describe(dir)?.layers {
        let path = dir.join(&layer.file);
        let (mut file, _) = regular::open(&path).map_err(Error::io("open", &path))?;
        for section in &layer.sections {
            file.seek(SeekFrom::Start(section.offset)).map_err(Error::io("read", &path))?;
            let found = checksum::of_reader((&mut file).take(section.bytes));
            let found = found.map_err(Error::io("read", &path))?.to_string();
            if found != section.blake3 {
                return Err(Error::Corrupt {
                    path,
                    what: "checksum",
                    expected: format!("{} for `{}`", section.blake3, section.name),
                    found,
                });
            }
        }
    }
    Ok(())
}
