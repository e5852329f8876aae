//! Matches of two outputs, as places in the full pictures.

use crate::{Density, Error, PredictOptions};
use selenograph_engine::HeadOutput;
use selenograph_engine::matching::{
    Described, DescriptorMap, Matcher, PixelPair, inside_border, reciprocal_symmetric,
};
use selenograph_geometry::{Point2, pixel};
use selenograph_network::input::InputTransform;
use selenograph_reconstruct::matching::Match;

/// Matches for the pose, and those of all pixels where they are asked for.
pub(crate) struct Matches {
    pub published: Vec<Match>,
    pub dense: Option<Vec<Match>>,
}

/// Matches a pair. `backward` is the pair decoded the other way round (B first), where it was.
pub(crate) fn find(
    forward: &[HeadOutput; 2],
    backward: Option<&[HeadOutput; 2]>,
    transforms: [&InputTransform; 2],
    options: &PredictOptions,
) -> Result<Matches, Error> {
    let placed = |pairs: Vec<PixelPair>| -> Vec<Match> {
        let sizes = forward.each_ref().map(|output| (output.width_px, output.height_px));
        let inside = pairs.into_iter().filter(|pair| inside_border(*pair, sizes, options.border_px));
        inside.map(|pair| place(pair, forward, transforms)).collect()
    };
    let [a, b] = forward.each_ref().map(described);
    let mut matcher = Matcher::new(a.map, b.map)?;
    let published = match backward {
        None => matcher.reciprocal(options.subsample_px)?,
        Some([of_b, of_a]) => {
            let ways = [[a, b], [described(of_a), described(of_b)]];
            reciprocal_symmetric(ways, options.subsample_px)?.into_iter().map(|(pair, _)| pair).collect()
        }
    };
    let dense = (options.density == Density::Dense).then(|| placed(matcher.reciprocal_dense()));
    Ok(Matches { published: placed(published), dense })
}

fn described(output: &HeadOutput) -> Described<'_> {
    let map = DescriptorMap {
        height_px: output.height_px,
        width_px: output.width_px,
        dim: output.descriptor_dim,
        values: &output.descriptors,
    };
    Described { map, confidence: &output.descriptor_confidence }
}

/// Places from the pictures' corners; the score is that of the less sure side, descriptor times point.
fn place(pair: PixelPair, outputs: &[HeadOutput; 2], transforms: [&InputTransform; 2]) -> Match {
    let [a, b] = [0, 1].map(|k| {
        let [x, y] = pair[k].map(|index| index as usize);
        let at = transforms[k].source_from_input(pixel::center_of(x), pixel::center_of(y));
        let idx = y * outputs[k].width_px + x;
        let score = outputs[k].descriptor_confidence[idx] * outputs[k].confidence[idx];
        (Point2::new(at[0], at[1]), f64::from(score))
    });
    Match { a: a.0, b: b.0, score: a.1.min(b.1) }
}
