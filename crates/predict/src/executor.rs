//! What runs a network: the one place where a further executor is added.

use crate::Error;
use crate::predictor::{Progress, Step};
use selenograph_engine::{Encoding, Engine, HeadOutput, Image, Probe, Simd, Stage};
use selenograph_network::{Checkpoint, NetworkConfig};
use serde::{Deserialize, Serialize};

/// What runs a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Executor {
    /// The engine for processors.
    #[default]
    Cpu,
}

impl Executor {
    /// What runs, in words.
    pub fn describe(self) -> String {
        match self {
            Self::Cpu => format!("CPU engine ({})", Simd::detect().name()),
        }
    }
}

/// A network that is loaded.
pub(crate) enum Loaded {
    Cpu(Engine),
}

impl Loaded {
    pub fn new(checkpoint: &Checkpoint, executor: Executor, progress: Report<'_>) -> Result<Self, Error> {
        let of = checkpoint.layout().num_parameters();
        let mut done = 0;
        match executor {
            Executor::Cpu => {
                let mut source = |name: &str| {
                    let (shape, values) = checkpoint.read_with_shape(name)?;
                    done += values.len();
                    progress(Progress { step: Step::Load, done: done.min(of), of });
                    Ok((shape, values))
                };
                Ok(Self::Cpu(Engine::new(checkpoint.config(), &mut source)?))
            }
        }
    }

    pub fn config(&self) -> &NetworkConfig {
        match self {
            Self::Cpu(engine) => engine.config(),
        }
    }

    pub fn encode(&self, images: &[Image<'_>], progress: Report<'_>) -> Result<Vec<Encoding>, Error> {
        let mut watch = Watch::new(progress, self.config(), 0);
        match self {
            Self::Cpu(engine) => Ok(engine.encode_probed(images, &mut watch)?),
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
        }
    }
}

/// Who is told of progress.
pub(crate) type Report<'a> = &'a mut dyn FnMut(Progress);

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
