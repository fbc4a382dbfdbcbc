//! Sizes of garments: from body dimensions and their deviations to one size, two neighbors, or "not sure".
//!
//! Charts are data (`assets/size_charts.toml`, after EN 13402-3); a shop gives its own. They describe bodies, not garments.
//! The probability of a size is the mass of a normal distribution within its interval of the primary dimension, times
//! that within the intervals of the secondary ones, widened by half a size: few people have the usual build throughout.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::avatar::mannequin::Sex;

/// The charts that come with the program
const CHARTS: &str = include_str!("../../../assets/size_charts.toml");

/// The answer is one size from this probability on
const ONE_SIZE: f64 = 0.75;

/// ... two neighboring ones from this sum on
const TWO_SIZES: f64 = 0.85;

/// Least weight that a secondary dimension leaves a size: builds differ, the primary dimension decides
const SECONDARY_FLOOR: f64 = 0.15;

/// Whom a chart is for
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names say it")]
pub enum ChartSex {
    Female,
    Male,
}

impl ChartSex {
    /// Of somebody who is one of the two
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
    /// What people call it
    pub name: String,
    /// What the labels are, for instance `EU`
    pub system: String,
    /// Whom it is for; everybody when `None`
    pub sex: Option<ChartSex>,
    /// Kind of garment
    pub garment: String,
    /// Key of the measure that decides
    pub primary: String,
    /// Keys of the measures that tell how well the build agrees
    pub secondary: Vec<String>,
    /// Small to large
    pub sizes: Vec<Size>,
}

/// One size: intervals in mm, lower bound inside
#[derive(Debug, Clone, PartialEq)]
pub struct Size {
    /// Its label
    pub name: String,
    /// Interval of each measure that it names
    pub intervals_mm: Vec<(String, [f64; 2])>,
}

impl Size {
    fn interval_mm(&self, key: &str) -> Option<[f64; 2]> {
        let entry = self.intervals_mm.iter().find(|(k, _)| k == key);
        entry.map(|(_, interval)| *interval)
    }
}

/// Why a chart cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ChartError {
    #[error("not a size chart: {0}")]
    Toml(#[from] toml::de::Error),
    #[error("there is no `[[chart]]`")]
    Empty,
    #[error(
        "chart \"{chart}\": there is no size; give `size = [ {{ name = .., {primary} = [from, to] }}, .. ]`"
    )]
    NoSizes { chart: String, primary: String },
    #[error(
        "chart \"{chart}\", size \"{size}\": `{key}` is no measure with a value in cm; see measurements.json for the names"
    )]
    UnknownMeasure {
        chart: String,
        size: String,
        key: String,
    },
    #[error(
        "chart \"{chart}\", size \"{size}\": `{key}` runs from {from} to {to} cm; the bounds must rise and be positive"
    )]
    Interval {
        chart: String,
        size: String,
        key: String,
        from: f64,
        to: f64,
    },
    #[error("chart \"{chart}\", size \"{size}\": it lacks the primary measure `{primary}`")]
    NoPrimary {
        chart: String,
        size: String,
        primary: String,
    },
    #[error(
        "chart \"{chart}\": sizes must be in rising order of `{primary}` without overlap; \"{size}\" is not"
    )]
    Order {
        chart: String,
        size: String,
        primary: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    chart: Vec<ChartEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChartEntry {
    name: String,
    #[serde(default)]
    system: String,
    sex: Option<ChartSex>,
    #[serde(default)]
    garment: String,
    primary: String,
    #[serde(default)]
    secondary: Vec<String>,
    size: Vec<SizeEntry>,
}

#[derive(Deserialize)]
struct SizeEntry {
    name: String,
    #[serde(flatten)]
    intervals: std::collections::BTreeMap<String, [f64; 2]>,
}

/// The charts that come with the program
///
/// # Panics
/// Never: they are part of the program, and a test reads them.
pub fn built_in_charts() -> Vec<Chart> {
    parse_charts(CHARTS).expect("the charts of the program are sound")
}

/// Reads charts in the form of `assets/size_charts.toml`
///
/// # Errors
/// When it is no TOML, has keys that are not known, or sizes that do not rise; the message says where.
pub fn parse_charts(text: &str) -> Result<Vec<Chart>, ChartError> {
    let file: File = toml::from_str(text)?;
    if file.chart.is_empty() {
        return Err(ChartError::Empty);
    }
    file.chart.into_iter().map(check_chart).collect()
}

fn check_chart(entry: ChartEntry) -> Result<Chart, ChartError> {
    let (chart, primary) = (entry.name.clone(), entry.primary.clone());
    if entry.size.is_empty() {
        return Err(ChartError::NoSizes { chart, primary });
    }
    let known = |key: &str| crate::measure::Measure::ALL.iter().any(|m| m.name() == key);
    let mut sizes: Vec<Size> = Vec::new();
    for size in entry.size {
        let mut intervals_mm = Vec::new();
        for (key, [from, to]) in size.intervals {
            let (chart, size) = (chart.clone(), size.name.clone());
            if !known(&key) {
                return Err(ChartError::UnknownMeasure { chart, size, key });
            }
            if !(from >= 0.0 && to > from && to.is_finite()) {
                return Err(ChartError::Interval {
                    chart,
                    size,
                    key,
                    from,
                    to,
                });
            }
            intervals_mm.push((key, [10.0 * from, 10.0 * to]));
        }
        let checked = Size {
            name: size.name,
            intervals_mm,
        };
        let (chart, size) = (chart.clone(), checked.name.clone());
        let Some([from, _]) = checked.interval_mm(&primary) else {
            let primary = primary.clone();
            return Err(ChartError::NoPrimary {
                chart,
                size,
                primary,
            });
        };
        let before = sizes.last().and_then(|s| s.interval_mm(&primary));
        if before.is_some_and(|[_, to]| from < to - 1e-9) {
            let primary = primary.clone();
            return Err(ChartError::Order {
                chart,
                size,
                primary,
            });
        }
        sizes.push(checked);
    }
    Ok(Chart {
        name: entry.name,
        system: entry.system,
        sex: entry.sex,
        garment: entry.garment,
        primary: entry.primary,
        secondary: entry.secondary,
        sizes,
    })
}

/// What a chart says about a person
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// Name of the chart
    pub chart: String,
    /// What the labels are
    pub system: String,
    /// Whom the chart is for
    pub sex: Option<ChartSex>,
    /// Kind of garment
    pub garment: String,
    /// The size, two neighboring ones (the likelier first), or none when not sure
    pub sizes: Vec<String>,
    /// In words: how sure that is, and why there is no size
    pub verdict: String,
    /// Of all sizes with one percent or more
    pub probabilities: Vec<(String, f64)>,
    /// The size that each measure alone asks for
    pub by_measure: Vec<(String, Option<String>)>,
}

/// A body dimension with its standard deviation, in mm
pub type Dimension = (f64, f64);

/// What a chart says about a person whose dimensions `dimension` knows by their keys
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
    // What lies beyond the chart's ends keeps its share.
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

/// Mass of a normal distribution within an interval
fn normal_mass(mean: f64, sd: f64, [from, to]: [f64; 2]) -> f64 {
    if sd.is_nan() || sd <= 0.0 {
        return f64::from((from..to).contains(&mean));
    }
    normal_below((to - mean) / sd) - normal_below((from - mean) / sd)
}

/// Cumulative standard normal distribution
///
/// # Source
/// Abramowitz and Stegun 1964, eq. 26.2.17; off by 7.5e-8 at most.
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn chart(name: &str) -> Chart {
        let charts = built_in_charts();
        let found = charts.into_iter().find(|c| c.name == name);
        found.expect("there is a chart of that name")
    }

    fn letters() -> Chart {
        chart("EN 13402-3, men, letters, tops")
    }

    fn advice(chart: &Chart, dimensions: &[(&str, f64, f64)]) -> Advice {
        advise(chart, &|key| {
            let entry = dimensions.iter().find(|(k, _, _)| *k == key);
            entry.map(|(_, mm, sd)| (*mm, *sd))
        })
    }

    #[test]
    fn the_middle_of_an_interval_is_one_size() {
        let found = advice(
            &letters(),
            &[("bust_girth", 980.0, 15.0), ("waist_girth", 860.0, 12.0)],
        );
        assert_eq!(found.sizes, ["M"]);
        assert_eq!(found.by_measure[0].1.as_deref(), Some("M"));
    }

    #[test]
    fn an_edge_is_two_sizes_and_the_build_tells_which_first() {
        let slim = [("bust_girth", 1020.0, 15.0), ("waist_girth", 800.0, 12.0)];
        assert_eq!(advice(&letters(), &slim).sizes[0], "M");
        let alone = [("bust_girth", 1021.0, 15.0)];
        assert_eq!(advice(&letters(), &alone).sizes, ["L", "M"]);
        let stout = [("bust_girth", 1020.0, 15.0), ("waist_girth", 1010.0, 12.0)];
        assert_eq!(advice(&letters(), &stout).sizes[0], "L");
    }

    #[test]
    fn who_is_not_known_well_or_not_in_the_chart_gets_no_size() {
        for (mm, sd) in [(980.0, 120.0), (400.0, 15.0), (2000.0, 15.0)] {
            let found = advice(&letters(), &[("bust_girth", mm, sd)]);
            assert!(found.sizes.is_empty(), "{found:?}");
            assert!(found.verdict.starts_with("not sure"));
        }
        let found = advice(&letters(), &[("waist_girth", 900.0, 10.0)]);
        assert!(found.verdict.contains("bust girth could not be measured"));
    }

    #[test]
    fn german_sizes_follow_the_bust() {
        let women = chart("EN 13402-3, women, tops and dresses");
        for (bust_mm, size) in [(760.0, "32"), (920.0, "40"), (1040.0, "46"), (1100.0, "48")] {
            let found = advice(&women, &[("bust_girth", bust_mm, 5.0)]);
            assert_eq!(found.sizes, [size]);
        }
    }

    #[test]
    fn charts_that_make_no_sense_are_refused_with_the_place() {
        let error = |text: &str| parse_charts(text).unwrap_err().to_string();
        assert!(error("x = 3").contains("x"));
        assert!(error("").contains("[[chart]]"));
        let sized = |sizes: &str| {
            format!("[[chart]]\nname = \"own\"\nprimary = \"bust_girth\"\nsize = [{sizes}]")
        };
        assert!(error(&sized("")).contains("no size"));
        assert!(error(&sized("{ name = \"S\", bust = [80, 90] }")).contains("`bust`"));
        assert!(error(&sized("{ name = \"S\", waist_girth = [80, 90] }")).contains("primary"));
        assert!(error(&sized("{ name = \"S\", bust_girth = [90, 80] }")).contains("90"));
        assert!(error(&sized("{ name = \"S\", bust_girth = [nan, 80] }")).contains("\"S\""));
        let both =
            "{ name = \"S\", bust_girth = [80, 90] }, { name = \"M\", bust_girth = [85, 95] }";
        assert!(error(&sized(both)).contains("\"M\""));
        let good =
            "{ name = \"S\", bust_girth = [80, 90] }, { name = \"M\", bust_girth = [90, 99] }";
        assert_eq!(parse_charts(&sized(good)).unwrap()[0].sizes.len(), 2);
    }

    #[test]
    fn normal_masses_are_those_of_the_tables() {
        assert!((normal_mass(0.0, 1.0, [-1.0, 1.0]) - 0.682_689).abs() < 1e-6);
        assert!((normal_below(1.96) - 0.975_002).abs() < 1e-6);
        assert!((normal_mass(3.0, 0.0, [2.0, 4.0]) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn probabilities_are_probabilities_and_sizes_neighbors(
            bust in 500.0..1900.0f64,
            waist in 500.0..1900.0f64,
            sd in 0.0..80.0f64,
        ) {
            for chart in built_in_charts() {
                let found = advise(&chart, &|key| match key {
                    "bust_girth" | "hip_girth" => Some((bust, sd)),
                    "neck_girth" => Some((bust / 2.5, sd)),
                    _ => Some((waist, sd)),
                });
                let sum: f64 = found.probabilities.iter().map(|p| p.1).sum();
                prop_assert!(sum <= 1.01, "{:?}", found);
                prop_assert!(found.sizes.len() <= 2);
                let place = |name: &String| chart.sizes.iter().position(|s| s.name == *name);
                if let [a, b] = &found.sizes[..] {
                    let (a, b) = (place(a).unwrap(), place(b).unwrap());
                    prop_assert_eq!(a.abs_diff(b), 1);
                }
            }
        }
    }
}
