//! What runs a network: the one place where a further executor is added.

use crate::Error;
use crate::progress::{Progress, Report, Step};
use selenograph_engine::{Encoding, Engine, HeadOutput, Image, Probe, Simd, Stage};
#[cfg(feature = "burn")]
use selenograph_model::Model;
use selenograph_network::{Checkpoint, NetworkConfig};
use serde::{Deserialize, Serialize};

#[cfg(feature = "burn")]
mod burn;

/// What runs a network.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Executor {
    /// The engine for processors.
    #[default]
    Cpu,
    /// burn, on its device of that name: `cuda:0`, `wgpu:0`, or `cpu` for a comparison with the engine.
    #[cfg(feature = "burn")]
    Burn(String),
}

impl Executor {
    /// What the command line calls `cpu`, `burn-cpu`, `cuda:0`, `wgpu:0`; the device must be there.
    ///
    /// # Errors
    /// [`Error::Device`] for what this build has not; as `model::device::parse` for a device that is not there.
    pub fn named(name: &str) -> Result<Self, Error> {
        match name {
            "cpu" => Ok(Self::Cpu),
            #[cfg(feature = "burn")]
            other => {
                let device = if other == "burn-cpu" { "cpu" } else { other };
                selenograph_model::device::parse(device)?;
                Ok(Self::Burn(device.to_owned()))
            }
            #[cfg(not(feature = "burn"))]
            other => Err(Error::Device { name: other.to_owned() }),
        }
    }

    /// What runs, in words.
    pub fn describe(&self) -> String {
        match self {
            Self::Cpu => format!("CPU engine ({})", Simd::detect().name()),
            #[cfg(feature = "burn")]
            Self::Burn(device) => format!("burn on {device}"),
        }
    }
}

/// A network that is loaded.
pub(crate) enum Loaded {
    Cpu(Box<Engine>),
    #[cfg(feature = "burn")]
    Burn(Box<Model>),
}

impl Loaded {
    pub fn new(checkpoint: &Checkpoint, executor: &Executor, progress: Report<'_>) -> Result<Self, Error> {
        let of = checkpoint.layout().num_parameters();
        let mut done = 0;
        let mut source = |name: &str| {
            let (shape, values) = checkpoint.read_with_shape(name)?;
            done += values.len();
            progress(Progress { step: Step::Load, done: done.min(of), of });
            Ok((shape, values))
        };
        match executor {
            Executor::Cpu => Ok(Self::Cpu(Box::new(Engine::new(checkpoint.config(), &mut source)?))),
            #[cfg(feature = "burn")]
            Executor::Burn(name) => {
                let device = selenograph_model::device::parse(name)?;
                Ok(Self::Burn(Box::new(Model::new(checkpoint.config(), &device, &mut source)?)))
            }
        }
    }

    pub fn config(&self) -> &NetworkConfig {
        match self {
            Self::Cpu(engine) => engine.config(),
            #[cfg(feature = "burn")]
            Self::Burn(model) => model.config(),
        }
    }

    pub fn encode(&self, images: &[Image<'_>], progress: Report<'_>) -> Result<Vec<Encoding>, Error> {
        let mut watch = Watch::new(progress, self.config(), 0);
        match self {
            Self::Cpu(engine) => Ok(engine.encode_probed(images, &mut watch)?),
            #[cfg(feature = "burn")]
            Self::Burn(model) => burn::encode(model, images, &mut watch),
        }
    }

    pub fn decode(
        &self,
        pairs: &[(&Encoding, &Encoding)],
        progress: Report<'_>,
    ) -> Result<Vec<[HeadOutput; 2]>, Error> {
        let mut watch = Watch::new(progress, self.config(), 2 * pairs.len());
        match self {
            Self::Cpu(engine) => Ok(engine.decode_probed(pairs, &mut watch)?),
            #[cfg(feature = "burn")]
            Self::Burn(model) => burn::decode(model, pairs, &mut watch),
        }
    }
}

/// Blocks and heads as they are finished.
struct Watch<'a> {
    report: Report<'a>,
    blocks: [usize; 2],
    heads: usize,
}

impl<'a> Watch<'a> {
    fn new(report: Report<'a>, config: &NetworkConfig, heads: usize) -> Self {
        Self { report, blocks: [config.encoder.num_blocks, config.decoder.num_blocks], heads }
    }
}

impl Probe for Watch<'_> {
    fn wants_values(&self) -> bool {
        false
    }

    fn finished(&mut self, stage: Stage) {
        let (step, done, of) = match stage {
            Stage::EncoderBlock { idx } => (Step::Encode, idx + 1, self.blocks[0]),
            Stage::DecoderBlock { idx } => (Step::Decode, idx + 1, self.blocks[1]),
            Stage::Head { pair, view } => (Step::Heads, 2 * pair + view + 1, self.heads),
            _ => return,
        };
        (self.report)(Progress { step, done, of });
    }
}
