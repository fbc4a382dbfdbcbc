//! Garment sizes: computes from body dimensions and their standard deviations one size, two neighboring sizes, or "not
//! sure".
//!
//! Charts are data (built-in ones after EN 13402-3); a shop provides its own. They describe bodies, not garments. A garment
//! must be large enough at all its dimensions, since it can be taken in, but not let out: the size is the largest of
//! those that the dimensions indicate alone. Its probability follows from the normal distributions of all of them. The
//! verdict names the measure that decides, and those that alone indicate other sizes.

use serde::{Deserialize, Serialize};

use crate::measure::Measurements;

use pirouette_body::Sex;

/// Minimum probability for recommending one size
const ONE_SIZE: f64 = 0.75;

/// Minimum sum of probabilities for recommending two neighboring sizes
const TWO_SIZES: f64 = 0.85;

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
    /// Keys of the secondary measures, which may require a larger size than the primary one
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
    /// In words: the probability and the deciding measure, or why there is no size
    pub verdict: String,
    /// Key of the measure that requires the likeliest size instead of a smaller one
    pub decided_by: Option<String>,
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
        decided_by: None,
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
            "not sure: the {} could not be measured, or has no standard deviation",
            name(&chart.primary)
        );
        return advice;
    };
    let covers = |size: &Size| {
        let interval = size.interval_mm(&chart.primary)?;
        Some(normal_mass(primary_mm, primary_sd, interval))
    };
    let inside: f64 = chart.sizes.iter().filter_map(covers).sum();
    let limits = limits(chart, dimension);
    // Probability that a size is large enough, for all sizes, small to large
    let enough = |size: usize| -> f64 {
        let below = limits.iter().map(|limit| limit.holds(size));
        below.product()
    };
    let share = |size: usize| match size.checked_sub(1) {
        Some(smaller) => (enough(size) - enough(smaller)).max(0.0),
        None => enough(size),
    };
    let largest = chart.sizes.len().saturating_sub(1);
    let beyond = limits.iter().find(|limit| limit.holds(largest) < 0.5);
    let primary = (inside < 0.5).then_some((chart.primary.as_str(), primary_mm));
    if let Some((key, mm)) = primary.or_else(|| Some((beyond?.key, beyond?.mm))) {
        advice.verdict = format!(
            "not sure: a {} of {mm:.0} mm lies outside the chart",
            name(key)
        );
        return advice;
    }
    let shares: Vec<f64> = (0..chart.sizes.len()).map(share).collect();
    let rounded = |p: f64| (p * 1000.0).round() / 1000.0;
    for (size, &share) in chart.sizes.iter().zip(&shares) {
        if share >= 0.01 {
            let entry = (size.name.clone(), rounded(share));
            advice.probabilities.push(entry);
        }
    }
    let likelier = |&a: &usize, &b: &usize| shares[a].total_cmp(&shares[b]);
    let Some(best) = (0..shares.len()).max_by(likelier) else {
        return advice;
    };
    let neighbors = [best.checked_sub(1), Some(best + 1)].into_iter().flatten();
    let second = neighbors.filter(|&i| i < shares.len()).max_by(likelier);
    let percent = |i: usize| format!("{} ({:.0} %)", chart.sizes[i].name, 100.0 * shares[i]);
    let decides = limits.iter().min_by(|a, b| {
        let smaller = best.saturating_sub(1);
        a.excess(smaller).total_cmp(&b.excess(smaller))
    });
    advice.decided_by = decides.map(|limit| limit.key.to_owned());
    let chosen = if shares[best] >= ONE_SIZE {
        vec![best]
    } else {
        let two = second.filter(|&s| shares[best] + shares[s] >= TWO_SIZES);
        two.map_or_else(Vec::new, |second| vec![best, second])
    };
    advice.verdict = match chosen[..] {
        [] => format!("not sure: the likeliest is {}", percent(best)),
        _ => {
            let sizes: Vec<String> = chosen.iter().map(|&i| percent(i)).collect();
            sizes.join(" or ")
        }
    };
    advice.sizes = chosen
        .iter()
        .map(|&i| chart.sizes[i].name.clone())
        .collect();
    advice.verdict += &reasons(&advice, &chart.sizes[best].name);
    advice
}

/// Returns which measure decides and which measures alone indicate other sizes; empty if all indicate `best`
fn reasons(advice: &Advice, best: &str) -> String {
    let name = |key: &str| key.replace('_', " ");
    let others = advice.by_measure.iter().filter_map(|(key, alone)| {
        let alone = alone.as_ref().filter(|alone| *alone != best)?;
        (Some(key) != advice.decided_by.as_ref()).then(|| format!("{}: {alone}", name(key)))
    });
    let others: Vec<String> = others.collect();
    match &advice.decided_by {
        Some(decides) if !others.is_empty() => {
            format!(", by the {} ({} alone)", name(decides), others.join(", "))
        }
        _ => String::new(),
    }
}

/// A measure of a person and the upper limits of the sizes
struct Limit<'a> {
    key: &'a str,
    mm: f64,
    sd: f64,
    /// Upper limit of each size in mm, never decreasing
    upper_mm: Vec<f64>,
}

impl Limit<'_> {
    /// Returns the probability that the measure is below the upper limit of a size
    fn holds(&self, size: usize) -> f64 {
        let below = self.upper_mm.get(size);
        below.map_or(0.0, |&to| {
            normal_mass(self.mm, self.sd, [f64::NEG_INFINITY, to])
        })
    }

    /// Returns by how many standard deviations the measure is below the upper limit of a size
    fn excess(&self, size: usize) -> f64 {
        /// Smaller standard deviations, in mm, count as this
        const SMALLEST_SD: f64 = 1e-6;
        let to = self.upper_mm.get(size).copied().unwrap_or_default();
        (to - self.mm) / self.sd.max(SMALLEST_SD)
    }
}

/// Returns the measures of a person that have limits in a chart
fn limits<'a>(chart: &'a Chart, dimension: &dyn Fn(&str) -> Option<Dimension>) -> Vec<Limit<'a>> {
    let keys = std::iter::once(&chart.primary).chain(&chart.secondary);
    let limit = |key: &'a String| {
        let (mm, sd) = dimension(key)?;
        let intervals = chart.sizes.iter().map(|size| size.interval_mm(key));
        // Sizes without an interval are smaller than the first that has one, or have no limit.
        let [mut highest, _] = intervals.clone().flatten().next()?;
        let last = chart
            .sizes
            .iter()
            .rposition(|size| size.interval_mm(key).is_some())?;
        let upper = intervals.enumerate().map(|(index, interval)| {
            highest = interval.map_or(highest, |[_, to]| to.max(highest));
            if index > last { f64::INFINITY } else { highest }
        });
        let upper_mm = upper.collect();
        Some(Limit {
            key,
            mm,
            sd,
            upper_mm,
        })
    };
    keys.filter_map(limit).collect()
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

    /// Sizes 40, 42, 44, 46 and 48, 4 cm each, with the waist 14 cm below the bust and the hip 6 cm above
    fn dresses() -> Chart {
        let size = |i: i32| {
            let from = 900.0 + 40.0 * f64::from(i);
            let interval = |shift: f64| [from + shift, from + shift + 40.0];
            let keys = [("bust", 0.0), ("waist", -140.0), ("hip", 60.0)];
            Size {
                name: (40 + 2 * i).to_string(),
                intervals_mm: keys
                    .map(|(key, shift)| (key.to_owned(), interval(shift)))
                    .to_vec(),
            }
        };
        Chart {
            name: "dresses".into(),
            system: String::new(),
            sex: None,
            garment: String::new(),
            primary: "bust".into(),
            secondary: vec!["waist".into(), "hip".into()],
            sizes: (0..5).map(size).collect(),
        }
    }

    fn advice(bust: f64, waist: f64, hip: f64, sd: f64) -> Advice {
        advise(&dresses(), &|key| {
            let mm = match key {
                "bust" => bust,
                "waist" => waist,
                _ => hip,
            };
            Some((mm, sd))
        })
    }

    #[test]
    fn the_largest_measure_decides() {
        // Alone: 42, 46 and 44.
        let found = advice(960.0, 900.0, 1060.0, 8.0);
        assert_eq!(found.sizes, ["46"]);
        assert_eq!(found.decided_by.as_deref(), Some("waist"));
        assert_eq!(
            found.verdict,
            "46 (99 %), by the waist (bust: 42, hip: 44 alone)"
        );
        let found = advice(960.0, 820.0, 1020.0, 8.0);
        assert_eq!(found.verdict, "42 (98 %)");
    }

    #[test]
    fn the_standard_deviation_of_each_measure_enters() {
        let found = advise(&dresses(), &|key| match key {
            "bust" => Some((960.0, 5.0)),
            "waist" => Some((820.0, 30.0)),
            _ => Some((1020.0, 5.0)),
        });
        // The waist is above 840 mm with 25 %.
        assert_eq!(found.sizes, ["42", "44"]);
        assert!(
            (found.probabilities[0].1 - 0.747).abs() < 0.002,
            "{found:?}"
        );
        assert_eq!(found.decided_by.as_deref(), Some("bust"));
    }

    #[test]
    fn a_secondary_measure_outside_the_chart_gives_no_size() {
        let found = advice(960.0, 1100.0, 1020.0, 8.0);
        assert!(found.sizes.is_empty());
        assert!(
            found.verdict.contains("waist of 1100 mm"),
            "{}",
            found.verdict
        );
    }

    #[test]
    fn normal_probabilities_agree_with_tables() {
        assert!((normal_mass(0.0, 1.0, [-1.0, 1.0]) - 0.682_689).abs() < 1e-6);
        assert!((normal_below(1.96) - 0.975_002).abs() < 1e-6);
        assert!((normal_mass(3.0, 0.0, [2.0, 4.0]) - 1.0).abs() < 1e-12);
    }
}
