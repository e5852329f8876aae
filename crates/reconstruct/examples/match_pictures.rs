//! Matches of two pictures: `match_pictures A B OUT [MASK_A MASK_B]`.
//!
//! Reads what `reconstruct` reads. Where a mask is white, its picture counts as not there (shadows, say). Finds the similarity (shift, turn,
//! scale) that most matches agree on, for pictures of the same ground from the same direction, prints it and how far the matches lie
//! from it, and writes `OUT/matches.csv` (pixels from the corners, score) and `OUT/matches.png` (both pictures side by side, every match a
//! line: green within 5 px of where the similarity puts it, else red).
#![allow(clippy::print_stdout, reason = "an example for engineers")]

use selenograph_geometry::Vector2;
use selenograph_geometry::pixel::index_of;
use selenograph_raster::Raster;
use selenograph_raster::codec::picture::read_picture;
use selenograph_raster::codec::png;
use selenograph_reconstruct::features::sift;
use selenograph_reconstruct::matching::{self, Match};
use selenograph_reconstruct::relative_pose::SiftOptions;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;

/// Distances from the similarity that are counted, pixels.
const WITHIN_PX: [f64; 4] = [1.0, 2.0, 5.0, 10.0];
/// A match up to here agrees.
const AGREES_PX: f64 = 5.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [a, b, out, masks @ ..] = arguments.as_slice() else {
        return Err("usage: match_pictures A B OUT [MASK_A MASK_B]".into());
    };
    let [a, b] = [(a, 0), (b, 1)].map(|(path, k)| picture(path, masks.get(k)));
    let (a, b) = (a?, b?);
    let options = SiftOptions::default();
    // Pictures that differ as much as a photograph and a rendering need the finest features too.
    let [of_a, of_b] = [&a, &b].map(|picture| sift::detect(picture, &options.retry));
    let matches = matching::sift(&of_a, &of_b, &options.matching);
    let out = Path::new(out);
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("matches.csv"), table(&matches)?)?;
    println!("{} and {} features, {} matches", of_a.keypoints.len(), of_b.keypoints.len(), matches.len());
    let similarity = Similarity::of(&matches);
    std::fs::write(out.join("matches.png"), png::encode_rgb8(&drawing(&a, &b, &matches, &similarity))?)?;
    println!(
        "similarity: scale {:.4}, turn {:.3}°, the corner to ({:.2}, {:.2})",
        similarity.turn[0].hypot(similarity.turn[1]),
        similarity.turn[1].atan2(similarity.turn[0]).to_degrees(),
        similarity.shift.x,
        similarity.shift.y
    );
    for limit in WITHIN_PX {
        let near = matches.iter().filter(|m| similarity.distance_px(m) < limit).count();
        println!(
            "within {limit} px of it: {near} ({:.1} %)",
            100.0 * near as f64 / matches.len().max(1) as f64
        );
    }
    Ok(())
}

/// `b = turn · a + shift`, the turn (with the scale) as a complex number.
struct Similarity {
    turn: [f64; 2],
    shift: Vector2<f64>,
}

impl Similarity {
    /// From the median displacement, then least squares over those that agree, a few times with a narrowing limit.
    fn of(matches: &[Match]) -> Self {
        let median = |axis: usize| {
            let mut along: Vec<f64> = matches.iter().map(|m| m.b[axis] - m.a[axis]).collect();
            along.sort_by(f64::total_cmp);
            along.get(along.len() / 2).copied().unwrap_or(0.0)
        };
        let mut found = Self { turn: [1.0, 0.0], shift: Vector2::new(median(0), median(1)) };
        for limit in [4.0, 2.0, 1.0, 1.0, 1.0].map(|factor| factor * AGREES_PX) {
            let near: Vec<&Match> = matches.iter().filter(|m| found.distance_px(m) < limit).collect();
            if near.len() < 3 {
                break;
            }
            found = Self::fitted(&near);
        }
        found
    }

    fn fitted(matches: &[&Match]) -> Self {
        let count = matches.len() as f64;
        let middle_a = matches.iter().map(|m| m.a.coords).sum::<Vector2<f64>>() / count;
        let middle_b = matches.iter().map(|m| m.b.coords).sum::<Vector2<f64>>() / count;
        let (mut dot, mut cross, mut square) = (0.0, 0.0, 0.0);
        for m in matches {
            let (p, q) = (m.a.coords - middle_a, m.b.coords - middle_b);
            dot += p.dot(&q);
            cross += p.perp(&q);
            square += p.norm_squared();
        }
        let turn = [dot / square, cross / square];
        let mut fitted = Self { turn, shift: Vector2::zeros() };
        fitted.shift = middle_b - fitted.turned(&middle_a);
        fitted
    }

    fn turned(&self, p: &Vector2<f64>) -> Vector2<f64> {
        let [c, s] = self.turn;
        Vector2::new(c * p.x - s * p.y, s * p.x + c * p.y)
    }

    fn distance_px(&self, m: &Match) -> f64 {
        (m.b.coords - self.turned(&m.a.coords) - self.shift).norm()
    }
}

fn picture(path: &str, mask: Option<&String>) -> Result<Raster<f32>, Box<dyn Error>> {
    let mut picture = read_picture(Path::new(path))?.grey;
    if let Some(mask) = mask {
        let mask = read_picture(Path::new(mask))?.grey;
        if (mask.width, mask.height) != (picture.width, picture.height) {
            return Err("a mask has another size than its picture".into());
        }
        for (level, masked) in picture.data.iter_mut().zip(&mask.data) {
            if *masked > 0.5 {
                *level = f32::NAN;
            }
        }
    }
    Ok(picture)
}

fn table(matches: &[Match]) -> Result<String, std::fmt::Error> {
    let mut text = String::from("a_x_px,a_y_px,b_x_px,b_y_px,score\n");
    for m in matches {
        writeln!(text, "{:.4},{:.4},{:.4},{:.4},{:.4}", m.a.x, m.a.y, m.b.x, m.b.y, m.score)?;
    }
    Ok(text)
}

fn drawing(a: &Raster<f32>, b: &Raster<f32>, matches: &[Match], similarity: &Similarity) -> Raster<[u8; 3]> {
    let mut sheet = Raster::from_fn(a.width + b.width, a.height.max(b.height), |_, _| [60u8; 3]);
    for (picture, left) in [(a, 0), (b, a.width)] {
        let largest =
            picture.data.iter().copied().filter(|v| v.is_finite()).fold(f32::MIN_POSITIVE, f32::max);
        for y in 0..picture.height {
            for x in 0..picture.width {
                let level = picture[(x, y)];
                if level.is_finite() {
                    sheet[(x + left, y)] = [(255.0 * level / largest).clamp(0.0, 255.0) as u8; 3];
                }
            }
        }
    }
    for m in matches {
        let colour = if similarity.distance_px(m) < AGREES_PX { [40, 200, 80] } else { [220, 50, 40] };
        line(&mut sheet, [m.a.x, m.a.y], [m.b.x + a.width as f64, m.b.y], colour);
    }
    sheet
}

fn line(sheet: &mut Raster<[u8; 3]>, from: [f64; 2], to: [f64; 2], colour: [u8; 3]) {
    let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0);
    for k in 0..=steps as usize {
        let share = k as f64 / steps;
        let [x, y] = [0, 1].map(|axis| index_of(from[axis] + share * (to[axis] - from[axis])));
        if (0..sheet.width as i64).contains(&x) && (0..sheet.height as i64).contains(&y) {
            sheet[(x as usize, y as usize)] = colour;
        }
    }
}
