//! The page of the tapes study: its text and its two pictures.

use super::*;

pub(super) fn page(options: &TapesOptions, scanned: &[Scanned], tables: &[Table]) -> String {
    let mut page = String::new();
    let failed = scanned.iter().filter(|s| s.error.is_some()).count();
    let _ = write!(
        page,
        "# Accuracy of the tape measures\n\n\
         `pirouette eval tapes` generates this page from scans of {} random people, women and men with body mass indices from 17\n\
         to 38, rendered with sway, noisy keypoints, turn angles that are off by 2 degrees, and statures stated with a standard\n\
         deviation of {STATED_STATURE_SD_MM:.0} mm. Their seeds were not used during development. The true values are those of the same tape on\n\
         the known body. {failed} of {} scans failed.\n\n\
         Rendered people differ from real ones: no clothes, no hair, no breathing, and the tapes are positioned by the same rules\n\
         on the true and on the reconstructed body. For comparison, the tables contain the limits of ISO 20685-1 on the mean\n\
         error of a scanner, the mean absolute error of the best published method with two photos, and that of a regression on\n\
         height and weight. This is not a claim of conformity.\n\n\
         All values are in mm. `SD` is the standard deviation of the errors over people, `MAE` the mean absolute error, `P90` the\n\
         90th percentile of the absolute error; `repeat` is the standard deviation of a second scan of the same person with\n\
         other sway and another stated stature; `within 1 sd` is the percentage of errors smaller than the standard deviation\n\
         reported with the value: 68 if it is well calibrated, more here, since 12 mm are assumed for stated statures.\n\
         [faults.md](faults.md) contains the results for wrong input, [detector.md](detector.md) those of the pose detector.\n\n",
        options.people.max(options.photo_people),
        scanned.len(),
    );
    let _ = write!(
        page,
        "![Errors of girths from photos](accuracy-errors.svg)\n\n\
         ![Errors by number of views](accuracy-views.svg)\n\n"
    );
    for table in tables {
        let _ = writeln!(page, "{}", table.to_section());
    }
    page.push_str(&recommendation(options, scanned));
    page
}

/// Draws a strip per girth: every person's error as a dot, bias and spread
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
