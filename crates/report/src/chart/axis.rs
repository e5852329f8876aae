//! Axes: ranges, ticks and their labels.

/// How values become positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Scale {
    /// Equal differences, equal lengths.
    #[default]
    Linear,
    /// Equal ratios, equal lengths; values that are not positive are left out.
    Log,
}

/// One axis of a plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// What it counts, with the unit.
    pub(crate) label: String,
    /// How values become positions.
    pub(crate) scale: Scale,
    /// Ends; from the data where absent.
    pub(crate) range: Option<[f64; 2]>,
    /// Names at 0, 1, 2, … in place of numbers.
    pub(crate) names: Vec<String>,
}

impl Axis {
    /// A linear axis whose ends come from the data.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// With a logarithmic scale.
    pub fn log(mut self) -> Self {
        self.scale = Scale::Log;
        self
    }

    /// With fixed ends.
    pub fn between(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }

    /// Names instead of numbers.
    pub(crate) fn categories(names: &[String]) -> Self {
        Self { names: names.to_vec(), ..Self::default() }
    }

    /// Ends for these values, a little wider than they are.
    pub(crate) fn ends(&self, values: impl Iterator<Item = f64>) -> [f64; 2] {
        if !self.names.is_empty() {
            return [-0.6, self.names.len() as f64 - 0.4];
        }
        let log = self.scale == Scale::Log;
        if let Some([low, high]) = self.range
            && low.is_finite()
            && high > low
            && (!log || low > 0.0)
        {
            return [low, high];
        }
        let usable = values.filter(|v| v.is_finite() && (!log || *v > 0.0));
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return if log { [0.1, 10.0] } else { [0.0, 1.0] };
        }
        if log {
            return if high > low * 1.01 { [low / 1.1, high * 1.1] } else { [low / 3.0, high * 3.0] };
        }
        let margin = if high > low { 0.04 * (high - low) } else { 0.5 * low.abs().max(1.0) };
        // Axes of counts and errors begin at zero, not a margin below it.
        [if low >= 0.0 && low <= 0.3 * high { 0.0 } else { low - margin }, high + margin]
    }

    /// Share of the axis' length at which a value lies; `None` where it has no place.
    pub(crate) fn share(&self, value: f64, [low, high]: [f64; 2]) -> Option<f64> {
        let share = match self.scale {
            Scale::Linear => (value - low) / (high - low),
            Scale::Log if value > 0.0 => (value / low).ln() / (high / low).ln(),
            Scale::Log => return None,
        };
        share.is_finite().then_some(share)
    }

    /// Values with their labels.
    pub(crate) fn ticks(&self, ends: [f64; 2], about: usize) -> Vec<(f64, String)> {
        if !self.names.is_empty() {
            return self.names.iter().enumerate().map(|(k, name)| (k as f64, name.clone())).collect();
        }
        match self.scale {
            Scale::Linear => linear_ticks(ends, about),
            Scale::Log => log_ticks(ends),
        }
    }
}

/// Multiples of 1, 2 or 5 times a power of ten.
pub(crate) fn linear_ticks([low, high]: [f64; 2], about: usize) -> Vec<(f64, String)> {
    let raw = (high - low) / about.max(1) as f64;
    if !(raw.is_finite() && raw > 0.0) {
        return Vec::new();
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw * 0.999);
    let step = step.unwrap_or(10.0 * power);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    let largest = low.abs().max(high.abs());
    (first..=last).map(|k| (k as f64 * step, label(k as f64 * step, step, largest))).collect()
}

fn log_ticks([low, high]: [f64; 2]) -> Vec<(f64, String)> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let decades = high.log10() - low.log10();
    let within: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let every = (f64::from(last - first) / 8.0).ceil().max(1.0) as i32;
    (first..=last)
        .filter(|exponent| (exponent - first) % every == 0)
        .flat_map(|exponent| within.iter().map(move |m| m * 10f64.powi(exponent)))
        .filter(|value| (low * 0.999..=high * 1.001).contains(value))
        .map(|value| (value, crate::number::significant(value, 1)))
        .collect()
}

/// As many decimals as the step needs.
fn label(value: f64, step: f64, largest: f64) -> String {
    if !(1e-4..1e7).contains(&largest) {
        return crate::number::significant(value, 3);
    }
    let decimals = usize::try_from(-(step.log10() + 1e-9).floor() as i64).unwrap_or(0);
    crate::number::fixed(value, decimals)
}
