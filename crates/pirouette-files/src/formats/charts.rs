//! Size charts in TOML, and the built-in ones.

use pirouette::measure::Measure;
use pirouette::sizes::{Chart, ChartSex, Size};
use serde::Deserialize;
use thiserror::Error;

/// The built-in charts
const CHARTS: &str = include_str!("../../assets/size_charts.toml");

/// Why a chart cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
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
        "chart \"{chart}\", size \"{size}\": `{key}` is not a measure in cm; see measurements.json for the names"
    )]
    UnknownMeasure {
        chart: String,
        size: String,
        key: String,
    },
    #[error(
        "chart \"{chart}\", size \"{size}\": `{key}` runs from {from} to {to} cm; bounds must be positive and increasing"
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
        "chart \"{chart}\": sizes must be in increasing order of `{primary}` without overlap; \"{size}\" is not"
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

/// Returns the built-in charts
///
/// # Panics
/// Never: a test parses them.
pub fn built_in_charts() -> Vec<Chart> {
    parse_charts(CHARTS).expect("the built-in charts are valid")
}

/// Parses charts in the format of `assets/size_charts.toml`
///
/// # Errors
/// When the text is not TOML, has unknown keys, or sizes are not in increasing order; the message names the place.
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
    let known = |key: &str| Measure::ALL.iter().any(|m| m.name() == key);
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
    let secondary = entry.secondary.iter();
    for key in std::iter::once(&entry.primary).chain(secondary) {
        close_gaps(&mut sizes, key);
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

/// Largest gap between the intervals of neighboring sizes, in mm, that is due to whole centimeters
const LARGEST_GAP_MM: f64 = 10.0;

/// Extends the intervals of charts in whole centimeters by half the gaps between them
///
/// "82 to 86, 87 to 91" is meant for rounded values: 86.4 belongs to the first size, 86.6 to the second.
fn close_gaps(sizes: &mut [Size], key: &str) {
    let mut intervals: Vec<&mut [f64; 2]> = Vec::new();
    for size in sizes {
        let all = size.intervals_mm.iter_mut();
        intervals.extend(all.filter(|(k, _)| k == key).map(|(_, interval)| interval));
    }
    let gaps: Vec<f64> = intervals
        .windows(2)
        .map(|pair| pair[1][0] - pair[0][1])
        .collect();
    let whole = |gap: &f64| (1e-9..=LARGEST_GAP_MM + 1e-9).contains(gap);
    let (Some(first), Some(last)) = (gaps.first(), gaps.last()) else {
        return;
    };
    if !gaps.iter().all(whole) {
        return;
    }
    for (index, interval) in intervals.iter_mut().enumerate() {
        let before = index.checked_sub(1).and_then(|before| gaps.get(before));
        interval[0] -= before.unwrap_or(first) / 2.0;
        interval[1] += gaps.get(index).unwrap_or(last) / 2.0;
    }
}

#[cfg(test)]
mod tests {
    use pirouette::sizes::{Advice, advise};

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
    fn the_middle_of_an_interval_gives_one_size() {
        let found = advice(
            &letters(),
            &[("bust_girth", 980.0, 15.0), ("waist_girth", 860.0, 12.0)],
        );
        assert_eq!(found.sizes, ["M"]);
        assert_eq!(found.by_measure[0].1.as_deref(), Some("M"));
    }

    #[test]
    fn a_boundary_gives_two_sizes_ordered_by_build() {
        let slim = [("bust_girth", 1019.0, 15.0), ("waist_girth", 800.0, 12.0)];
        assert_eq!(advice(&letters(), &slim).sizes, ["M", "L"]);
        let alone = [("bust_girth", 1021.0, 15.0)];
        assert_eq!(advice(&letters(), &alone).sizes, ["L", "M"]);
        let stout = [("bust_girth", 1019.0, 15.0), ("waist_girth", 950.0, 12.0)];
        let found = advice(&letters(), &stout);
        assert_eq!(found.sizes, ["L"]);
        assert_eq!(found.decided_by.as_deref(), Some("waist_girth"));
    }

    #[test]
    fn charts_in_whole_centimeters_have_no_gaps() {
        let sizes = "{ name = \"S\", bust_girth = [82, 86] }, { name = \"M\", bust_girth = [87, 91] }, \
                     { name = \"L\", bust_girth = [92, 96] }";
        let text =
            format!("[[chart]]\nname = \"whole\"\nprimary = \"bust_girth\"\nsize = [{sizes}]");
        let chart = &parse_charts(&text).unwrap()[0];
        for (bust_mm, size) in [
            (815.5, "S"),
            (864.0, "S"),
            (866.7, "M"),
            (914.0, "M"),
            (964.0, "L"),
        ] {
            let found = advice(chart, &[("bust_girth", bust_mm, 0.1)]);
            assert_eq!(found.sizes, [size]);
            assert_eq!(found.by_measure[0].1.as_deref(), Some(size));
        }
        // A larger gap is not due to rounding; who is in it needs the larger size.
        let wide = text.replace("[92, 96]", "[100, 104]");
        let chart = &parse_charts(&wide).unwrap()[0];
        assert_eq!(
            chart.sizes[1].interval_mm("bust_girth"),
            Some([870.0, 910.0])
        );
    }

    #[test]
    fn uncertain_or_out_of_range_measurements_give_no_size() {
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
    fn invalid_charts_are_rejected_with_the_place() {
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

    proptest! {
        #[test]
        fn probabilities_are_valid_and_sizes_adjacent(
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
