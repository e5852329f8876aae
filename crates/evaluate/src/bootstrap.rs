//! Confidence intervals over distinct geometries.
//!
//! The lights of one pair share terrain, cameras and truth: they are no independent cases. Whole geometries are drawn with
//! replacement, each with all its items.

use selenograph_dataset::rng::rng;
use selenograph_raster::statistics;

/// Draws of an interval: its ends then vary by about a fortieth of its width.
const NUM_DRAWS: usize = 2000;
/// Ends of the interval: 95 %.
const ENDS: [f64; 2] = [0.025, 0.975];
/// Every interval of every table is drawn from the same stream, so that two methods meet the same geometries.
const SEED: u64 = 1;

/// How values become one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// Arithmetic mean over items.
    Mean,
    /// Median over items.
    Median,
}

/// A number with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Over all items.
    pub value: f64,
    /// 95 % interval by percentiles of the bootstrap; absent with one geometry.
    pub interval: Option<[f64; 2]>,
    /// Items with a value.
    pub num_items: usize,
    /// Geometries with a value.
    pub num_geometries: usize,
}

/// The statistic of all items, with its interval. `groups`: the values of each geometry; empty groups do not count. `None`
/// without a value.
pub fn estimate(groups: &[Vec<f64>], statistic: Statistic) -> Option<Estimate> {
    let groups: Vec<&Vec<f64>> = groups.iter().filter(|group| !group.is_empty()).collect();
    let value = of_groups(groups.iter().copied(), statistic)?;
    let interval =
        (groups.len() > 1).then(|| statistics::quantiles(replicates(&groups, statistic), ENDS)).flatten();
    Some(Estimate {
        value,
        interval,
        num_items: groups.iter().map(|group| group.len()).sum(),
        num_geometries: groups.len(),
    })
}

/// The statistic of each draw.
fn replicates(groups: &[&Vec<f64>], statistic: Statistic) -> Vec<f64> {
    let mut stream = rng(SEED, "bootstrap", 0, "geometries");
    (0..NUM_DRAWS)
        .filter_map(|_| {
            let drawn: Vec<&Vec<f64>> = groups.iter().map(|_| groups[stream.index(groups.len())]).collect();
            of_groups(drawn.into_iter(), statistic)
        })
        .collect()
}

fn of_groups<'a>(groups: impl Iterator<Item = &'a Vec<f64>>, statistic: Statistic) -> Option<f64> {
    match statistic {
        Statistic::Mean => {
            let (sum, count) = groups.fold((0.0, 0usize), |(sum, count), group| {
                (sum + group.iter().sum::<f64>(), count + group.len())
            });
            (count > 0).then(|| sum / count as f64)
        }
        Statistic::Median => statistics::median(groups.flatten().copied()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_geometries_have_the_three_means_of_the_binomial() {
        // Means of the draws are 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4: the ends of 95 % are 0 and 1.
        let groups = [vec![0.0; 3], vec![1.0; 3]];
        let found = estimate(&groups, Statistic::Mean).unwrap();
        assert_eq!((found.value, found.interval), (0.5, Some([0.0, 1.0])));
        assert_eq!((found.num_items, found.num_geometries), (6, 2));
        let draws = replicates(&groups.iter().collect::<Vec<_>>(), Statistic::Mean);
        let share = |mean: f64| draws.iter().filter(|d| **d == mean).count() as f64 / draws.len() as f64;
        // Four standard errors of a share of 2000 draws.
        let tolerance = 4.0 * (0.25f64 / NUM_DRAWS as f64).sqrt();
        assert!((share(0.0) - 0.25).abs() < tolerance && (share(0.5) - 0.5).abs() < tolerance);
        assert_eq!(draws, replicates(&groups.iter().collect::<Vec<_>>(), Statistic::Mean));
    }

    #[test]
    fn the_spread_of_the_means_is_that_of_the_sample_over_its_number() {
        let values: Vec<f64> = (0..40).map(|k| (f64::from(k) * 0.37).sin()).collect();
        let groups: Vec<Vec<f64>> = values.iter().map(|v| vec![*v]).collect();
        let draws = replicates(&groups.iter().collect::<Vec<_>>(), Statistic::Mean);
        let sample = statistics::summary(values).unwrap();
        let spread = statistics::summary(draws).unwrap();
        let expected = sample.sigma / 40f64.sqrt();
        // A standard deviation of 2000 draws is known to 1.6 %; four times that.
        assert!((spread.sigma / expected - 1.0).abs() < 0.064, "{} {expected}", spread.sigma);
        assert!((spread.mean - sample.mean).abs() < 4.0 * expected / (NUM_DRAWS as f64).sqrt());
    }

    #[test]
    fn lights_do_not_narrow_the_interval() {
        let once: Vec<Vec<f64>> = (0..10).map(|k| vec![f64::from(k)]).collect();
        let thrice: Vec<Vec<f64>> = (0..10).map(|k| vec![f64::from(k); 3]).collect();
        let [a, b] = [&once, &thrice].map(|groups| estimate(groups, Statistic::Mean).unwrap());
        // The same draws of the same means; sums of three differ by rounding.
        assert!((a.interval.unwrap()[0] - b.interval.unwrap()[0]).abs() < 1e-12);
        assert_eq!((a.num_geometries, b.num_geometries, b.num_items), (10, 10, 30));
    }

    #[test]
    fn medians_and_empty_groups() {
        let groups = [vec![1.0, 9.0], vec![], vec![5.0]];
        let found = estimate(&groups, Statistic::Median).unwrap();
        assert_eq!((found.value, found.num_geometries), (5.0, 2));
        assert!(estimate(&[vec![], vec![]], Statistic::Mean).is_none());
        assert!(estimate(&[vec![3.0]], Statistic::Mean).unwrap().interval.is_none());
    }
}
