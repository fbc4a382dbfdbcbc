//! Garment sizes: computes from body dimensions and their standard deviations one size, two neighboring sizes, or "not
//! sure".
//!
//! Charts are data (built-in ones after EN 13402-3); a shop provides its own. They describe bodies, not garments. The
//! probability of a size is the mass of a normal distribution within its interval of the primary dimension, times that
//! within the intervals of the secondary ones, widened by half a size: few people have the usual build throughout.

use serde::{Deserialize, Serialize};

use crate::measure::Measurements;

use pirouette_body::Sex;

/// Minimum probability for recommending one size
const ONE_SIZE: f64 = 0.75;

/// Minimum sum of probabilities for recommending two neighboring sizes
const TWO_SIZES: f64 = 0.85;

/// Lower bound of the factor of a secondary dimension: builds differ, the primary dimension decides
const SECONDARY_FLOOR: f64 = 0.15;

/// Group of people that a chart is for
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum ChartSex {
    Female,
    Male,
}

impl ChartSex {
    /// Returns the group of a person of a sex
    pub fn of(sex: Sex) -> Option<Self> {
        match sex {
            Sex::Female => Some(ChartSex::Female),
            Sex::Male => Some(ChartSex::Male),
            Sex::Neutral => None,
        }
    }
}

/// A table of sizes
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Name for people
    pub name: String,
    /// Labeling system, for instance `EU`
    pub system: String,
    /// Group that the chart is for; everybody when `None`
    pub sex: Option<ChartSex>,
    /// Kind of garment
    pub garment: String,
    /// Key of the primary measure
    pub primary: String,
    /// Keys of the secondary measures, which rate how well the build agrees
    pub secondary: Vec<String>,
    /// Sizes, small to large
    pub sizes: Vec<Size>,
}

/// One size: intervals in mm, lower bound included
#[derive(Debug, Clone, PartialEq)]
pub struct Size {
    /// Its label
    pub name: String,
    /// Interval of each of its measures
    pub intervals_mm: Vec<(String, [f64; 2])>,
}

impl Size {
    /// Returns the interval of a measure by its key, in mm
    pub fn interval_mm(&self, key: &str) -> Option<[f64; 2]> {
        let entry = self.intervals_mm.iter().find(|(k, _)| k == key);
        entry.map(|(_, interval)| *interval)
    }
}

/// Recommendation of a chart for a person
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// Name of the chart
    pub chart: String,
    /// Labeling system
    pub system: String,
    /// Group that the chart is for
    pub sex: Option<ChartSex>,
    /// Kind of garment
    pub garment: String,
    /// The size, two neighboring sizes (the likelier first), or none when not sure
    pub sizes: Vec<String>,
    /// In words: the probability, or why there is no size
    pub verdict: String,
    /// Probability of each size of one percent or more
    pub probabilities: Vec<(String, f64)>,
    /// The size that each measure alone indicates
    pub by_measure: Vec<(String, Option<String>)>,
}

/// A body dimension with its standard deviation, in mm
pub type Dimension = (f64, f64);

/// Evaluates a chart for a person whose dimensions `dimension` returns by their keys
pub fn advise(chart: &Chart, dimension: &dyn Fn(&str) -> Option<Dimension>) -> Advice {
    let mut advice = Advice {
        chart: chart.name.clone(),
        system: chart.system.clone(),
        sex: chart.sex,
        garment: chart.garment.clone(),
        sizes: Vec::new(),
        verdict: String::new(),
        probabilities: Vec::new(),
        by_measure: Vec::new(),
    };
    let name = |key: &str| key.replace('_', " ");
    for key in std::iter::once(&chart.primary).chain(&chart.secondary) {
        let alone = dimension(key).and_then(|(mm, _)| {
            let holds = |s: &&Size| {
                s.interval_mm(key)
                    .is_some_and(|[from, to]| (from..to).contains(&mm))
            };
            chart.sizes.iter().find(holds).map(|s| s.name.clone())
        });
        advice.by_measure.push((key.clone(), alone));
    }
    let Some((primary_mm, primary_sd)) = dimension(&chart.primary) else {
        advice.verdict = format!(
            "not sure: the {} could not be measured",
            name(&chart.primary)
        );
        return advice;
    };
    let mut weights: Vec<f64> = Vec::new();
    let mut inside = 0.0;
    for size in &chart.sizes {
        let primary = size.interval_mm(&chart.primary).map_or(0.0, |interval| {
            normal_mass(primary_mm, primary_sd, interval)
        });
        inside += primary;
        let secondary: f64 = chart
            .secondary
            .iter()
            .filter_map(|key| {
                let ((mm, sd), [from, to]) = (dimension(key)?, size.interval_mm(key)?);
                let half = (to - from) / 2.0;
                let mass = normal_mass(mm, sd, [from - half, to + half]);
                Some(SECONDARY_FLOOR + (1.0 - SECONDARY_FLOOR) * mass)
            })
            .product();
        weights.push(primary * secondary);
    }
    let sum: f64 = weights.iter().sum();
    if sum <= 0.0 || inside < 0.5 {
        advice.verdict = format!(
            "not sure: a {} of {:.0} mm lies outside the chart",
            name(&chart.primary),
            primary_mm
        );
        return advice;
    }
    // Values beyond the chart's ends keep their probability.
    let share = |i: usize| weights[i] / sum * inside;
    let rounded = |p: f64| (p * 1000.0).round() / 1000.0;
    for (i, size) in chart.sizes.iter().enumerate() {
        if share(i) >= 0.01 {
            let entry = (size.name.clone(), rounded(share(i)));
            advice.probabilities.push(entry);
        }
    }
    let best = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
    let Some(best) = best else {
        return advice;
    };
    let neighbors = [best.checked_sub(1), Some(best + 1)];
    let second = neighbors
        .into_iter()
        .flatten()
        .filter(|&i| i < weights.len())
        .max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
    let label = |i: usize| chart.sizes[i].name.clone();
    if share(best) >= ONE_SIZE {
        advice.sizes = vec![label(best)];
        advice.verdict = format!("{} ({:.0} %)", label(best), 100.0 * share(best));
    } else if let Some(second) = second.filter(|&s| share(best) + share(s) >= TWO_SIZES) {
        advice.sizes = vec![label(best), label(second)];
        advice.verdict = format!(
            "{} ({:.0} %) or {} ({:.0} %)",
            label(best),
            100.0 * share(best),
            label(second),
            100.0 * share(second)
        );
    } else {
        advice.verdict = format!(
            "not sure: the likeliest is {} with {:.0} %",
            label(best),
            100.0 * share(best)
        );
    }
    advice
}

/// Returns the mass of a normal distribution within an interval
fn normal_mass(mean: f64, sd: f64, [from, to]: [f64; 2]) -> f64 {
    if sd.is_nan() || sd <= 0.0 {
        return f64::from((from..to).contains(&mean));
    }
    normal_below((to - mean) / sd) - normal_below((from - mean) / sd)
}

/// Returns the cumulative standard normal distribution
///
/// # Source
/// Abramowitz and Stegun 1964, eq. 26.2.17; error at most 7.5e-8.
fn normal_below(z: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let series = [
        0.319_381_530,
        -0.356_563_782,
        1.781_477_937,
        -1.821_255_978,
        1.330_274_429,
    ];
    let sum = series.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let tail = (-z * z / 2.0).exp() / std::f64::consts::TAU.sqrt() * sum;
    if z > 0.0 { 1.0 - tail } else { tail }
}

/// Recommends sizes by the charts for the sex of the person; by all charts where the sex is unknown
pub fn advise_person(measurements: &Measurements, charts: &[Chart]) -> Vec<Advice> {
    let sex = measurements.subject.sex.and_then(ChartSex::of);
    let fits = |chart: &&Chart| sex.is_none() || chart.sex.is_none() || chart.sex == sex;
    let dimension = |key: &str| {
        let (_, measured) = measurements.iter().find(|(m, _)| m.name() == key)?;
        let known = measurements.in_mm().then_some(measured.value_mm.ok()?)?;
        Some((known, measured.sd_mm?))
    };
    let charts = charts.iter().filter(fits);
    charts.map(|chart| advise(chart, &dimension)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_probabilities_agree_with_tables() {
        assert!((normal_mass(0.0, 1.0, [-1.0, 1.0]) - 0.682_689).abs() < 1e-6);
        assert!((normal_below(1.96) - 0.975_002).abs() < 1e-6);
        assert!((normal_mass(3.0, 0.0, [2.0, 4.0]) - 1.0).abs() < 1e-12);
    }
}
