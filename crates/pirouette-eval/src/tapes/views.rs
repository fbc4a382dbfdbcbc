//! Errors by number of views, and the significance of their differences.

use super::page::svg_open;
use super::*;

/// Measures in the table by number of views
const BY_VIEWS: [Measure; 9] = [
    Measure::NeckGirth,
    Measure::BustGirth,
    Measure::WaistGirth,
    Measure::HipGirth,
    Measure::ThighGirth,
    Measure::CalfGirth,
    Measure::UpperArmGirth,
    Measure::WristGirth,
    Measure::CrotchHeight,
];

pub(super) fn at_views(views: usize) -> Condition {
    Condition {
        views,
        photos: false,
        again: 0,
    }
}

/// Returns the absolute errors of the people for whom numbers of views are compared
fn absolute_errors(
    options: &TapesOptions,
    scanned: &[Scanned],
    views: usize,
    measure: Measure,
) -> Vec<f64> {
    let place = Measure::ALL.iter().position(|&m| m == measure);
    let of = |seed: u64| {
        let found = compared(scanned, views, seed)?.found[place?]?;
        Some(found.error_mm().abs())
    };
    seeds(options).filter_map(of).collect()
}

fn seeds(options: &TapesOptions) -> impl Iterator<Item = u64> + use<> {
    options.first_seed..options.first_seed + options.view_people as u64
}

/// Returns the scan of a person by exact silhouettes with the given number of views
fn compared<'a, 'p>(
    scanned: &'a [Scanned<'p>],
    views: usize,
    seed: u64,
) -> Option<&'a Scanned<'p>> {
    let condition = at_views(views);
    let mut all = scanned.iter();
    all.find(|s| s.condition == condition && s.person.seed == seed)
}

pub(super) fn views_table(options: &TapesOptions, scanned: &[Scanned]) -> Table {
    let names: Vec<String> = BY_VIEWS
        .iter()
        .map(|m| m.name().replace('_', " "))
        .collect();
    let mut columns = vec!["views"];
    columns.extend(names.iter().map(String::as_str));
    let mut table = Table::new(
        "mean absolute error by number of views, exact silhouettes, the same people",
        &columns,
    );
    for &views in &options.views {
        let mut row = vec![Cell::Number(views as f64, 0)];
        row.extend(BY_VIEWS.iter().map(|&measure| {
            let errors = absolute_errors(options, scanned, views, measure);
            Cell::number(mean(&errors), 1)
        }));
        table.rows.push(row);
    }
    table
}

/// The girths used to compare numbers of views
const TRUNK: [Measure; 3] = [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth];

/// Differences above this number of standard errors are significant: with five comparisons, chance exceeds it once in
/// twenty studies
const SIGNIFICANT: f64 = 2.6;

/// Minimum number of people for a meaningful standard error
const LEAST_PEOPLE: usize = 10;

/// Mean of a quantity with its standard error
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sampled {
    mean: f64,
    standard_error: f64,
    count: usize,
}

impl Sampled {
    /// Computes mean and standard error; `None` for fewer than two values
    fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        let Spread { mean, sd } = Spread::of(values).filter(|_| count > 1)?;
        Some(Self {
            mean,
            standard_error: sd / ((count - 1) as f64).sqrt(),
            count,
        })
    }

    /// Returns whether the mean is significantly above zero
    fn is_positive(&self) -> bool {
        self.count >= LEAST_PEOPLE && self.mean > SIGNIFICANT * self.standard_error
    }
}

/// Returns the mean absolute error of a person's trunk girths; `None` if a girth is missing
fn trunk_error(scanned: &[Scanned], views: usize, seed: u64) -> Option<f64> {
    let scanned = compared(scanned, views, seed)?;
    let error = |measure: Measure| {
        let place = Measure::ALL.iter().position(|&m| m == measure)?;
        Some(scanned.found[place]?.error_mm().abs())
    };
    let errors: Option<Vec<f64>> = TRUNK.into_iter().map(error).collect();
    mean(&errors?)
}

/// Returns by how much the trunk errors are larger with one number of views than with another, paired by person
fn excess(
    options: &TapesOptions,
    scanned: &[Scanned],
    views: usize,
    other: usize,
) -> Option<Sampled> {
    let difference =
        |seed| Some(trunk_error(scanned, views, seed)? - trunk_error(scanned, other, seed)?);
    Sampled::of(&seeds(options).filter_map(difference).collect::<Vec<_>>())
}

pub(super) fn trunk_table(options: &TapesOptions, scanned: &[Scanned]) -> Table {
    let mut table = Table::new(
        format!(
            "bust, waist and hip: numbers of views compared with {USUAL_VIEWS}, paired by person"
        ),
        &[
            "views",
            "people",
            "MAE",
            "more than at 8",
            "standard error",
            "beyond chance",
        ],
    );
    for &views in &options.views {
        let errors: Vec<f64> = seeds(options)
            .filter_map(|seed| trunk_error(scanned, views, seed))
            .collect();
        let more = excess(options, scanned, views, USUAL_VIEWS).filter(|_| views != USUAL_VIEWS);
        let less = excess(options, scanned, USUAL_VIEWS, views);
        let beyond = |s: Option<Sampled>| s.is_some_and(|s| s.is_positive());
        let word = match (beyond(more), beyond(less)) {
            (true, _) => "worse",
            (_, true) => "better",
            _ => "-",
        };
        table.rows.push(vec![
            Cell::Number(views as f64, 0),
            Cell::Number(errors.len() as f64, 0),
            Cell::number(mean(&errors), 1),
            Cell::number(more.map(|s| s.mean), 1),
            Cell::number(more.map(|s| s.standard_error), 1),
            Cell::Text(word.to_owned()),
        ]);
    }
    table
}

/// Recommends the smallest number of views that no larger one improves significantly
pub(super) fn recommendation(options: &TapesOptions, scanned: &[Scanned]) -> String {
    let mut views = options.views.clone();
    views.sort_unstable();
    let compared = |v: usize| {
        let people = seeds(options).filter_map(|seed| trunk_error(scanned, v, seed));
        people.count() >= LEAST_PEOPLE
    };
    let mut text = String::from("## Recommended number of photos\n\n");
    if views.len() < 2 || !views.iter().all(|&v| compared(v)) {
        text.push_str("Too few people or numbers of views for a recommendation.\n");
        return text;
    }
    let beats = |better: usize, worse: usize| {
        excess(options, scanned, worse, better).is_some_and(|s| s.is_positive())
    };
    let enough = views
        .iter()
        .copied()
        .find(|&v| !views.iter().any(|&w| w > v && beats(w, v)));
    let Some(enough) = enough else {
        return text;
    };
    let listed = |list: Vec<usize>| {
        let words: Vec<String> = list.iter().map(usize::to_string).collect();
        words.join(", ")
    };
    let worse: Vec<usize> = views.iter().copied().filter(|&v| v < enough).collect();
    let more: Vec<usize> = views.iter().copied().filter(|&v| v > enough).collect();
    let _ = write!(text, "Take {enough} photos.");
    if !worse.is_empty() {
        let _ = write!(
            text,
            " With {}, the errors at the trunk are significantly larger than with a larger number.",
            listed(worse)
        );
    }
    if !more.is_empty() {
        let _ = write!(
            text,
            " With {}, they are not significantly smaller.",
            listed(more)
        );
    }
    let _ = writeln!(
        text,
        " Differences above {SIGNIFICANT} standard errors are significant; the same people are compared, with exact silhouettes."
    );
    text
}

/// Draws the mean absolute errors of the girths of trunk and thigh over the number of views
pub(super) fn views_svg(options: &TapesOptions, scanned: &[Scanned]) -> String {
    const LINES: [(Measure, &str); 4] = [
        (Measure::BustGirth, "#c33"),
        (Measure::WaistGirth, "#1f6fb2"),
        (Measure::HipGirth, "#2a8a3a"),
        (Measure::ThighGirth, "#b27a1f"),
    ];
    let (left, top, width, height, most) = (50.0, 15.0, 480.0, 220.0, 20.0);
    let count = options.views.len().max(2) as f64 - 1.0;
    let x = |i: usize| left + width * i as f64 / count;
    let y = |mm: f64| top + height * (1.0 - mm.clamp(0.0, most) / most);
    let mut svg = svg_open(left + width + 130.0, top + height + 45.0);
    for tick in [0.0, 5.0, 10.0, 15.0, 20.0] {
        let at = y(tick);
        let _ = writeln!(
            svg,
            "<line x1=\"{left}\" y1=\"{at}\" x2=\"{}\" y2=\"{at}\" stroke=\"#ccc\"/><text x=\"{}\" y=\"{}\" \
             text-anchor=\"end\">{tick}</text>",
            left + width,
            left - 6.0,
            at + 4.0
        );
    }
    for (i, views) in options.views.iter().enumerate() {
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{views}</text>",
            x(i),
            top + height + 18.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">views; mean absolute error in mm, bars: standard error</text>",
        left + width / 2.0,
        top + height + 38.0
    );
    for (measure, color) in LINES {
        let mut points = Vec::new();
        for (i, &v) in options.views.iter().enumerate() {
            let errors = absolute_errors(options, scanned, v, measure);
            let Some(Spread { mean, sd }) = Spread::of(&errors) else {
                continue;
            };
            let standard_error = sd / (errors.len() as f64).sqrt();
            points.push((x(i), y(mean)));
            let _ = writeln!(
                svg,
                "<line x1=\"{0:.1}\" y1=\"{1:.1}\" x2=\"{0:.1}\" y2=\"{2:.1}\" stroke=\"{color}\"/>",
                x(i),
                y(mean - standard_error),
                y(mean + standard_error)
            );
        }
        let path: Vec<String> = points
            .iter()
            .map(|p| format!("{:.1},{:.1}", p.0, p.1))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
            path.join(" ")
        );
        if let Some((x, y)) = points.last() {
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{}</text>",
                x + 6.0,
                y + 4.0,
                measure.name().replace('_', " ")
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_differences_of_several_standard_errors_are_significant() {
        let values: Vec<f64> = (0..20).map(|i| f64::from(i % 2) * 2.0 - 0.5).collect();
        let sampled = Sampled::of(&values).unwrap();
        assert!((sampled.mean - 0.5).abs() < 1e-12);
        assert!((sampled.standard_error - 1.0 / 19f64.sqrt()).abs() < 1e-12);
        assert!(!sampled.is_positive());
        let larger: Vec<f64> = values.iter().map(|v| v + 0.3).collect();
        assert!(Sampled::of(&larger).unwrap().is_positive());
        assert!(!Sampled::of(&larger[..8]).unwrap().is_positive());
        assert_eq!(Sampled::of(&[1.0]), None);
    }
}
