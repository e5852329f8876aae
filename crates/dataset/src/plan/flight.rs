//! Poses of the two cameras of a pair, one function per trajectory; each is a function of its section, the site, the
//! altitude level and a random stream, and tells every number it drew.

use super::campaign::Campaign;
use super::interval::Interval;
use super::sections::{
    AltitudeAbove, AltitudeStrategy, DEFAULT_TILT_DEG, DescentSection, DynamicSection, Heading, NadirSection,
    ObliqueSection, OffsetMeaning, SecondCamera,
};
use crate::pair::Trajectory;
use crate::rng::Stream;
use selenograph_geometry::{
    Body, BodyFixed, Cam, Error as GeometryError, Geodetic, Point3, Rigid3, Rotation3, Unit, Vector3, lookat,
};

/// A camera's pose.
pub type Pose = Rigid3<BodyFixed, Cam>;
/// Numbers drawn for a pair, by name; angles in degrees, lengths in metres.
pub type Parameters = Vec<(&'static str, f64)>;

/// What a pair is aimed at.
pub struct Aim<'a> {
    /// The sphere.
    pub body: &'a Body,
    /// The site; its height is the median of the ground round it.
    pub site: Geodetic,
    /// Nominal altitude, metres.
    pub level_m: f64,
    /// Which of the pairs of its level this is.
    pub pair_in_level: u64,
    /// Width of the ground that a camera sees from one metre.
    pub footprint_per_m: f64,
}

impl Aim<'_> {
    fn up(&self) -> Vector3<f64> {
        self.body.up(&self.site)
    }

    /// Radius of a height over the site.
    fn radius_m(&self, altitude_m: f64) -> f64 {
        self.body.radius_m + self.site.height_m + altitude_m
    }

    fn target(&self) -> Point3<f64> {
        self.body.point(&self.site)
    }

    fn horizontal(&self, azimuth_rad: f64) -> Vector3<f64> {
        self.body.direction(&self.site, azimuth_rad, 0.0)
    }

    /// The point at a radius, a central angle away from the site towards an azimuth.
    fn displaced(&self, azimuth_rad: f64, central_rad: f64, radius_m: f64) -> Point3<f64> {
        let direction = self.up() * central_rad.cos() + self.horizontal(azimuth_rad) * central_rad.sin();
        Point3::from(direction * radius_m)
    }
}

fn jittered(level_m: f64, share: f64, stream: &mut Stream) -> f64 {
    level_m * (1.0 + stream.uniform(-share, share))
}

fn turn(stream: &mut Stream) -> f64 {
    stream.uniform(0.0, std::f64::consts::TAU)
}

/// Straight down, with the image's right along `right`.
fn down(origin: Point3<f64>, right: &Vector3<f64>) -> Result<Pose, GeometryError> {
    lookat::from_forward_and_right(origin, &-origin.coords, right)
}

/// The two cameras of a pair.
///
/// # Errors
/// [`GeometryError::Degenerate`] for a draw that leaves a camera's roll undefined (the caller draws again).
pub fn poses(
    campaign: &Campaign,
    trajectory: Trajectory,
    aim: &Aim<'_>,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    match trajectory {
        Trajectory::Nadir => nadir(&campaign.nadir, aim, stream, drawn),
        Trajectory::Oblique => oblique(&campaign.oblique, aim, stream, drawn),
        Trajectory::Dynamic => dynamic(&campaign.dynamic, aim, stream, drawn),
        Trajectory::Descent => descent(&campaign.descent, aim, stream, drawn),
        Trajectory::LowLight => {
            let section = NadirSection { b_over_h: campaign.low_light.b_over_h, ..NadirSection::default() };
            nadir(&section, aim, stream, drawn)
        }
        Trajectory::NoOverlap => {
            let apart = campaign.no_overlap.footprints_apart.draw(stream);
            drawn.push(("footprints_apart", apart));
            level_flight(aim, aim.level_m, apart * aim.footprint_per_m * aim.level_m, stream, drawn)
        }
        Trajectory::Identical => {
            let [a, _] = level_flight(aim, aim.level_m, 0.0, stream, drawn)?;
            Ok([a, a])
        }
    }
}

/// Two cameras looking down from one altitude, `baseline_m` apart along a random heading, which is the image's right.
fn level_flight(
    aim: &Aim<'_>,
    altitude_m: f64,
    baseline_m: f64,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    let heading = turn(stream);
    drawn.push(("heading_deg", heading.to_degrees()));
    let radius = aim.radius_m(altitude_m);
    let right = aim.horizontal(heading);
    let central = 2.0 * (baseline_m / (2.0 * radius)).min(1.0).asin();
    Ok([
        down(Point3::from(aim.up() * radius), &right)?,
        down(aim.displaced(heading, central, radius), &right)?,
    ])
}

fn nadir(
    section: &NadirSection,
    aim: &Aim<'_>,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    let altitude = jittered(aim.level_m, section.altitude_jitter_share, stream);
    let b_over_h = section.b_over_h.draw(stream);
    drawn.extend([("altitude_m", altitude), ("b_over_h", b_over_h)]);
    let [a, mut b] = match section.heading {
        Heading::WorldY => {
            // The scripts' degenerate cross product falls back to the world's +Y.
            let (right, sign) = (Vector3::y(), stream.sign());
            drawn.push(("baseline_sign", sign));
            let radius = aim.radius_m(altitude);
            let first = aim.up() * radius;
            let second = (first + right * (sign * altitude * b_over_h)).normalize() * radius;
            [down(Point3::from(first), &right)?, down(Point3::from(second), &right)?]
        }
        Heading::Random | Heading::Free => level_flight(aim, altitude, altitude * b_over_h, stream, drawn)?,
    };
    if section.second_camera == SecondCamera::Converging {
        let right = b.vector(&Vector3::x());
        b = lookat::from_forward_and_right(b.origin(), &(aim.target() - b.origin()), &right)?;
    }
    Ok([a, b])
}

/// Altitudes of an oblique pair by the scripts' four strategies.
fn script_altitudes(section: &ObliqueSection, aim: &Aim<'_>, stream: &mut Stream) -> [f64; 2] {
    let low = (aim.level_m - section.altitude_band_m).max(1000.0f64.min(aim.level_m));
    let high = aim.level_m + section.altitude_band_m;
    let within = |share: f64| low + (high - low) * share;
    let strategy = stream.index(4);
    // Every strategy draws three numbers, so that the stream goes on alike.
    let (u, v, sign) = (stream.unit(), stream.unit(), stream.sign());
    match strategy {
        0 => [within(u), within(u)],
        1 => [within(u), (within(u) + sign * (500.0 + 500.0 * v)).clamp(low, high)],
        2 => {
            let (bottom, top) = (within(0.3 * u), within(0.7 + 0.3 * v));
            if sign > 0.0 { [bottom, top] } else { [top, bottom] }
        }
        _ => {
            let phase = 6.0 * std::f64::consts::PI * aim.pair_in_level as f64 / 100.0;
            let base = within(0.5 * (1.0 + phase.sin()));
            [base + 1000.0 * (u - 0.5), base + 1000.0 * (v - 0.5)].map(|h| h.clamp(low, high))
        }
    }
}

fn oblique(
    section: &ObliqueSection,
    aim: &Aim<'_>,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    let altitudes = match section.altitude_strategy {
        AltitudeStrategy::Scripts => script_altitudes(section, aim, stream),
        AltitudeStrategy::Level => {
            [(); 2].map(|()| jittered(aim.level_m, section.altitude_jitter_share, stream))
        }
    };
    let common = turn(stream);
    drawn.extend([
        ("altitude_a_m", altitudes[0]),
        ("altitude_b_m", altitudes[1]),
        ("azimuth_deg", common.to_degrees()),
    ]);
    let spread = section.azimuth_spread_deg;
    let one =
        |sign: f64, altitude: f64, stream: &mut Stream, drawn: &mut Parameters, names: [&'static str; 2]| {
            let azimuth = common + stream.uniform(-spread, spread).to_radians();
            drawn.push((names[0], azimuth.to_degrees()));
            let target =
                aim.target() + aim.horizontal(std::f64::consts::FRAC_PI_2) * (sign * section.target_shift_m);
            let camera_radius = match section.altitude_above {
                AltitudeAbove::Terrain => aim.radius_m(altitude),
                AltitudeAbove::Sphere => aim.body.radius_m + altitude,
            };
            let origin = match section.distance_over_altitude {
                Some(distances) => {
                    let distance = distances.draw(stream);
                    drawn.push((names[1], distance));
                    let ground = target.coords - aim.horizontal(azimuth) * (distance * altitude);
                    Point3::from(ground.normalize() * camera_radius)
                }
                None => {
                    let tilt = section.tilt_deg.unwrap_or(DEFAULT_TILT_DEG).draw(stream);
                    drawn.push((names[1], tilt));
                    behind(&target, &aim.horizontal(azimuth), tilt.to_radians(), camera_radius)?
                }
            };
            lookat::level(origin, &(target - origin), &origin.coords)
        };
    Ok([
        one(-1.0, altitudes[0], stream, drawn, ["azimuth_a_deg", "reach_a"])?,
        one(1.0, altitudes[1], stream, drawn, ["azimuth_b_deg", "reach_b"])?,
    ])
}

/// Where a camera at a radius stands so that it sees `target` in direction `along`, at `tilt` from its own vertical.
fn behind(
    target: &Point3<f64>,
    along: &Vector3<f64>,
    tilt_rad: f64,
    camera_radius: f64,
) -> Result<Point3<f64>, GeometryError> {
    let degenerate = GeometryError::Degenerate { what: "the tilt and the horizon" };
    let target_radius = target.coords.norm();
    // Law of sines in the triangle centre - target - camera.
    let sine = camera_radius * tilt_rad.sin() / target_radius;
    if sine >= 1.0 {
        return Err(degenerate);
    }
    let central = sine.asin() - tilt_rad;
    let up = target.coords / target_radius;
    let away = (up * up.dot(along) - along).try_normalize(1e-9).ok_or(degenerate)?;
    Ok(Point3::from((up * central.cos() + away * central.sin()) * camera_radius))
}

fn dynamic(
    section: &DynamicSection,
    aim: &Aim<'_>,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    let shift = stream.uniform(-section.target_shift_m, section.target_shift_m);
    let target = aim.target() + aim.horizontal(turn(stream)) * shift;
    let heading = turn(stream);
    let variation = section.altitude_variation_share;
    let mut altitudes = [(); 2].map(|()| jittered(aim.level_m, variation, stream));
    let origins = match section.b_over_h_of {
        OffsetMeaning::BetweenCameras => {
            let b_over_h = section.b_over_h.draw(stream);
            drawn.push(("b_over_h", b_over_h));
            // Drawn anew: where the altitudes differ by all of the baseline, one camera stands above the other.
            let most = (1.0 + b_over_h / 2.0) / (1.0 - b_over_h / 2.0).max(f64::EPSILON);
            let low = (aim.level_m * (1.0 - variation)).max(altitudes[0] / most);
            let high = (aim.level_m * (1.0 + variation)).min(altitudes[0] * most);
            altitudes[1] = stream.uniform(low, high);
            let [from, to] = altitudes.map(|altitude| aim.radius_m(altitude));
            let baseline = b_over_h * (altitudes[0] + altitudes[1]) / 2.0;
            // The chord between two points at different radii, solved for their central angle.
            let across = (baseline.powi(2) - (to - from).powi(2)).max(0.0);
            let half = (across / (4.0 * from * to)).sqrt().min(1.0).asin();
            [aim.displaced(heading, -half, from), aim.displaced(heading, half, to)]
        }
        OffsetMeaning::Horizontal => {
            let b_over_h = section.b_over_h.draw(stream);
            drawn.push(("b_over_h", b_over_h));
            let half = b_over_h * (altitudes[0] + altitudes[1]) / 4.0;
            [(-half, altitudes[0]), (half, altitudes[1])].map(|(along, altitude)| {
                let radius = aim.radius_m(altitude);
                aim.displaced(heading, along / radius, radius)
            })
        }
        OffsetMeaning::FromSite => {
            let mut one = |altitude: f64, name: &'static str| {
                let offset = section.b_over_h.draw(stream);
                drawn.push((name, offset));
                let place = aim.target().coords + aim.horizontal(turn(stream)) * (offset * altitude);
                Point3::from(place.normalize() * aim.radius_m(altitude))
            };
            [one(altitudes[0], "offset_over_h_a"), one(altitudes[1], "offset_over_h_b")]
        }
    };
    drawn.extend([
        ("altitude_a_m", altitudes[0]),
        ("altitude_b_m", altitudes[1]),
        ("heading_deg", heading.to_degrees()),
    ]);
    let right = (section.heading != Heading::Free).then(|| match section.heading {
        Heading::WorldY => Vector3::y(),
        _ => aim.horizontal(heading),
    });
    let names =
        [["off_axis_a_deg", "pitch_a_deg", "roll_a_deg"], ["off_axis_b_deg", "pitch_b_deg", "roll_b_deg"]];
    let look = |k: usize, stream: &mut Stream, drawn: &mut Parameters| {
        let to_target = target - origins[k];
        // The scripts' own right turns freely with the line of sight.
        let right = right.unwrap_or_else(|| to_target.cross(&aim.up()));
        shaken(section, origins[k], &to_target, &right, stream, drawn, names[k])
    };
    Ok([look(0, stream, drawn)?, look(1, stream, drawn)?])
}

/// A camera that points near its target: off the axis within a cone, then turned about its right, then rolled.
fn shaken(
    section: &DynamicSection,
    origin: Point3<f64>,
    to_target: &Vector3<f64>,
    right: &Vector3<f64>,
    stream: &mut Stream,
    drawn: &mut Parameters,
    names: [&'static str; 3],
) -> Result<Pose, GeometryError> {
    let steady: Pose = lookat::from_forward_and_right(origin, to_target, right)?;
    let cone = section.cone_deg[stream.weighted(&section.cone_weights)];
    let off_axis = stream.uniform(0.0, cone).to_radians();
    let around = turn(stream);
    let most = section.pitch_deg[stream.weighted(&section.pitch_weights)];
    let pitch = stream.uniform(-most, most).to_radians();
    let roll = stream.uniform(-section.roll_deg, section.roll_deg).to_radians();
    drawn.extend(names.into_iter().zip([off_axis, pitch, roll].map(f64::to_degrees)));
    let (sin_around, cos_around) = around.sin_cos();
    let axis = Unit::new_normalize(Vector3::new(cos_around, sin_around, 0.0));
    let turned = Rotation3::from_axis_angle(&axis, off_axis)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), pitch)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), roll);
    Ok(&steady * &Rigid3::<Cam, Cam>::new(turned, Point3::origin()))
}

fn descent(
    section: &DescentSection,
    aim: &Aim<'_>,
    stream: &mut Stream,
    drawn: &mut Parameters,
) -> Result<[Pose; 2], GeometryError> {
    let above = jittered(aim.level_m, section.altitude_jitter_share, stream);
    let ratio = section.altitude_ratio.draw(stream);
    let below = above * ratio;
    let drift = section.drift.draw(stream);
    let (heading, drift_azimuth) = (turn(stream), turn(stream));
    drawn.extend([
        ("altitude_a_m", above),
        ("altitude_ratio", ratio),
        ("drift", drift),
        ("heading_deg", heading.to_degrees()),
    ]);
    let right = aim.horizontal(heading);
    let radius = aim.radius_m(below);
    let origins = [
        Point3::from(aim.up() * aim.radius_m(above)),
        aim.displaced(drift_azimuth, drift * (above - below) / radius, radius),
    ];
    let mut look = |k: usize, roll_deg: f64, names: [&'static str; 2]| {
        let tilt = Interval::new(0.0, section.tilt_deg).draw(stream).to_radians();
        let around = turn(stream);
        let roll = stream.uniform(-roll_deg, roll_deg).to_radians();
        drawn.extend(names.into_iter().zip([tilt, roll].map(f64::to_degrees)));
        let (sin_around, cos_around) = around.sin_cos();
        let axis = Unit::new_normalize(Vector3::new(cos_around, sin_around, 0.0));
        let leaned =
            Rotation3::from_axis_angle(&axis, tilt) * Rotation3::from_axis_angle(&Vector3::z_axis(), roll);
        Ok(&down(origins[k], &right)? * &Rigid3::<Cam, Cam>::new(leaned, Point3::origin()))
    };
    // The pair's heading is A's; only B rolls against it.
    Ok([
        look(0, 0.0, ["tilt_a_deg", "roll_a_deg"])?,
        look(1, section.roll_deg, ["tilt_b_deg", "roll_b_deg"])?,
    ])
}
