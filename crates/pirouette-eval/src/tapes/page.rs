//! The page that the study of the tapes writes: its text and its two pictures.

use super::*;

pub(super) fn page(options: &TapesOptions, scanned: &[Scanned], tables: &[Table]) -> String {
    let mut page = String::new();
    let failed = scanned.iter().filter(|s| s.error.is_some()).count();
    let _ = write!(
        page,
        "# How accurate the tape measures are\n\n\
         `pirouette eval tapes` wrote this page: {} random people, women and men of body mass indices from 17 to 38, rendered\n\
         with sway, noisy keypoints, turn angles that are off by 2 degrees, and statures stated with a standard deviation of\n\
         {STATED_STATURE_SD_MM:.0} mm. Their seeds are not those that the method was made with. Truth is the same tape on the known body. {failed} of\n\
         {} scans failed.\n\n\
         Rendered people are not people: no clothes, no hair, no breath, and tapes that find their places by the same rules\n\
         on the true and on the found body. Beside the figures stand the limits of ISO 20685-1 on the mean error of a scanner,\n\
         what the best published method with two photos reaches (mean absolute error), and what a regression on height and\n\
         weight does. This is no claim of conformity.\n\n\
         All in mm. `SD` is the spread of the errors over people, `MAE` their mean size, `P90` the size that 90 % stay below;\n\
         `repeat` is the deviation of a second scan of the same person, swaying and told otherwise; `within 1 sd` is the share\n\
         of errors that are smaller than the standard deviation told with the value: 68 would be right.\n\n",
        options.people.max(options.photo_people),
        scanned.len(),
    );
    let _ = write!(
        page,
        "![Errors of girths from photos](accuracy-errors.svg)\n\n\
         ![Errors by number of views](accuracy-views.svg)\n\n"
    );
    for table in tables {
        let _ = write!(
            page,
            "## {}\n\n{}\n",
            capitalized(&table.title),
            markdown(table)
        );
    }
    page.push_str(&recommendation(options, scanned));
    page
}

fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

fn markdown(table: &Table) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&table.columns);
    text.push_str(&line(&vec!["---".to_owned(); table.columns.len()]));
    for row in &table.rows {
        text.push_str(&line(&row.iter().map(Cell::to_string).collect::<Vec<_>>()));
    }
    text
}

/// A strip per girth: every person's error as a dot, bias and spread
pub(super) fn errors_svg(scanned: &[Scanned], condition: Condition) -> String {
    let girths: Vec<Measure> = Measure::ALL
        .iter()
        .copied()
        .filter(|m| !m.girths().is_empty())
        .collect();
    let (row, left, width) = (24.0, 150.0, 560.0);
    let scale = width / 2.0 / 50.0;
    let middle = left + width / 2.0;
    let height = row * girths.len() as f64 + 40.0;
    let mut svg = svg_open(left + width + 20.0, height);
    for tick in [-50.0, -25.0, 0.0, 25.0, 50.0f64] {
        let x = middle + tick * scale;
        let _ = writeln!(
            svg,
            "<line x1=\"{x}\" y1=\"8\" x2=\"{x}\" y2=\"{}\" stroke=\"#ccc\"/><text x=\"{x}\" y=\"{}\" \
             text-anchor=\"middle\">{tick:+.0} mm</text>",
            height - 26.0,
            height - 10.0
        );
    }
    for (i, &girth) in girths.iter().enumerate() {
        let y = 20.0 + row * i as f64;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            left - 8.0,
            y + 4.0,
            girth.name().replace('_', " ")
        );
        let errors = errors(scanned, condition, girth);
        for e in &errors {
            let x = middle + e.clamp(-50.0, 50.0) * scale;
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y}\" r=\"3\" fill=\"#1f6fb2\" fill-opacity=\"0.4\"/>"
            );
        }
        if let Some(Spread { mean, sd }) = Spread::of(&errors) {
            let [a, b] = [mean - sd, mean + sd].map(|e| middle + e.clamp(-50.0, 50.0) * scale);
            let _ = writeln!(
                svg,
                "<line x1=\"{a:.1}\" y1=\"{y}\" x2=\"{b:.1}\" y2=\"{y}\" stroke=\"#c33\" stroke-width=\"3\"/>"
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

pub(super) fn svg_open(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    )
}
