//! Distances between two clouds: accuracy, completeness, Chamfer.

pub(crate) mod tree;

use rayon::prelude::*;
use selenograph_geometry::Point3;
use tree::Tree;

/// Distances between a predicted and a true cloud, in their unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudError {
    /// Mean distance from a predicted point to the nearest true one.
    pub accuracy: f64,
    /// Mean distance from a true point to the nearest predicted one.
    pub completeness: f64,
}

impl CloudError {
    /// Mean of both.
    pub fn chamfer(&self) -> f64 {
        0.5 * (self.accuracy + self.completeness)
    }
}

/// A cloud with its tree.
#[derive(Debug, Clone)]
pub struct Cloud {
    /// The points, all finite.
    pub points: Vec<Point3<f64>>,
    tree: Tree,
}

impl Cloud {
    /// From finite points.
    pub fn new(points: Vec<Point3<f64>>) -> Self {
        let tree = Tree::new(&points);
        Self { points, tree }
    }

    /// Mean distance from `points` to the nearest of this cloud; `None` if either is empty. A hint is a point of this
    /// cloud that is likely near: it saves time and changes nothing.
    pub fn mean_distance_from(
        &self,
        points: &[Point3<f64>],
        hint: impl Fn(usize) -> Option<Point3<f64>> + Sync,
    ) -> Option<f64> {
        if points.is_empty() || self.points.is_empty() {
            return None;
        }
        let distances: Vec<f64> = points
            .par_iter()
            .enumerate()
            .map(|(idx, point)| {
                let bound = hint(idx).map_or(f64::INFINITY, |near| (near - point).norm_squared());
                self.tree.nearest_squared(point, bound).sqrt()
            })
            .collect();
        Some(distances.iter().sum::<f64>() / distances.len() as f64)
    }
}

/// Both distances between clouds without hints; `None` if one is empty.
pub fn compare(predicted: &Cloud, truth: &Cloud) -> Option<CloudError> {
    Some(CloudError {
        accuracy: truth.mean_distance_from(&predicted.points, |_| None)?,
        completeness: predicted.mean_distance_from(&truth.points, |_| None)?,
    })
}

/// Diagonal of the axis-aligned box around the finite points; `None` if there are none.
pub fn box_diagonal(points: impl Iterator<Item = Point3<f64>>) -> Option<f64> {
    let finite = points.filter(|p| p.coords.iter().all(|c| c.is_finite()));
    let bounds = finite.fold(None, |bounds: Option<(Point3<f64>, Point3<f64>)>, p| {
        Some(bounds.map_or((p, p), |(low, high)| (low.inf(&p), high.sup(&p))))
    });
    bounds.map(|(low, high)| (high - low).norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_two_small_clouds() {
        let truth = Cloud::new([0.0, 1.0, 2.0, 3.0].map(|x| Point3::new(x, 0.0, 0.0)).to_vec());
        let predicted = Cloud::new(vec![Point3::new(0.0, 3.0, 4.0), Point3::new(1.0, 0.0, 0.0)]);
        let error = compare(&predicted, &truth).unwrap();
        assert_eq!((error.accuracy, error.completeness), (2.5, 1.0));
        assert_eq!(error.chamfer(), 1.75);
        let hinted = truth.mean_distance_from(&predicted.points, |_| Some(truth.points[3])).unwrap();
        assert_eq!(hinted, error.accuracy);
        assert_eq!(compare(&predicted, &Cloud::new(Vec::new())), None);
        assert_eq!(compare(&truth, &truth).map(|e| e.chamfer()), Some(0.0));
    }

    #[test]
    fn the_box_is_that_of_the_finite_points() {
        let points =
            [Point3::new(1.0, 2.0, 3.0), Point3::new(f64::NAN, 0.0, 0.0), Point3::new(4.0, 6.0, 3.0)];
        assert_eq!(box_diagonal(points.into_iter()), Some(5.0));
        assert_eq!(box_diagonal(std::iter::empty()), None);
    }
}
