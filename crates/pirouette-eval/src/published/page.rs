//! The results as pages: Markdown with separate pictures, and self-contained HTML.

use std::fmt::Write;

use pirouette_files::formats::photo::encode_photo_png;
use pirouette_files::report::{data_uri, escape_html};
use thiserror::Error;

use super::{Experiment, Picture, Results};
use crate::table::{Cell, Table};

/// Why a page cannot be written
#[derive(Debug, Error)]
pub enum PageError {
    /// A picture cannot be encoded
    #[error("the picture {name} cannot be encoded")]
    Picture {
        /// Name of the picture
        name: &'static str,
        /// Cause
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

const TITLE: &str = "Results";

const ABOUT: [&str; 4] = [
    "The results published in Zwettler et al., \"Three-step Alignment Approach for Fitting a Normalized Mask of a Person \
     Rotating in A-Pose or T-Pose\" (VISAPP 2021), reproduced with rendered people, and compared with the published figures. \
     `pirouette eval` generates this page; all seeds are fixed. Times depend on the machine, and so may the last digits of other \
     figures.",
    "The people are rendered: mannequins of random sex, stature and mass, whose surfaces are displaced by random smooth \
     fields, so that no mannequin has their shape. The results are not a claim about photos of real people, and the published \
     figures are of other people and pictures: a comparison of numbers, not of the same experiment.",
    "Every experiment also runs the same code with one part disabled. In pictures, red marks pixels that were found but are \
     not true, blue marks true pixels that were not found.",
    "Turn angles that are found in videos and photos, beside the error published in Baumgartner et al. 2020, are in \
     `videos.md` and `angles.md`, which `pirouette eval videos` and `pirouette eval angles` generate.",
];

/// A page as Markdown, and its pictures
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkdownPage {
    /// The page
    pub text: String,
    /// Names and contents of PNG files
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// Writes the page as Markdown
///
/// Links of pictures are relative to `folder`.
///
/// # Errors
/// When a picture cannot be encoded.
pub fn markdown(results: &Results, folder: &str) -> Result<MarkdownPage, PageError> {
    let mut text = format!("# {TITLE}\n\n");
    for paragraph in ABOUT {
        push(&mut text, format_args!("{paragraph}\n\n"));
    }
    markdown_table(&mut text, &results.summary());
    let mut files = Vec::new();
    for experiment in &results.experiments {
        push(&mut text, format_args!("## {}\n\n", experiment.title));
        for paragraph in &experiment.reading {
            push(&mut text, format_args!("{paragraph}\n\n"));
        }
        for table in &experiment.tables {
            push(&mut text, format_args!("**{}**\n\n", table.title));
            markdown_table(&mut text, table);
        }
        for picture in &experiment.pictures {
            let file = format!("{}.png", picture.name);
            let caption = &picture.caption;
            push(
                &mut text,
                format_args!("![{caption}]({folder}/{file})\n\n{caption}.\n\n"),
            );
            files.push((file, png(picture)?));
        }
    }
    let end = text.trim_end().len();
    text.truncate(end);
    text.push('\n');
    Ok(MarkdownPage {
        text,
        pictures: files,
    })
}

fn markdown_table(text: &mut String, table: &Table) {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    text.push_str(&line(table.columns.clone()));
    let numbers = |column: usize| {
        let mut rows = table.rows.iter();
        !rows.any(|row| matches!(row.get(column), Some(Cell::Text(_))))
    };
    let rule = (0..table.columns.len()).map(|c| if numbers(c) { "--:" } else { "---" });
    text.push_str(&line(rule.map(str::to_owned).collect()));
    for row in &table.rows {
        text.push_str(&line(row.iter().map(Cell::to_string).collect()));
    }
    text.push('\n');
    for note in &table.notes {
        push(text, format_args!("{note}\n\n"));
    }
}

const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
h2 { margin: 2.5rem 0 .6rem; }
p { max-width: 46rem; }
table { border-collapse: collapse; margin: .4rem 0 1.2rem; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
th, td { padding: .2rem .8rem; border-bottom: 1px solid #8885; text-align: left; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
figure { margin: 0 0 1.2rem; }
img { max-width: 100%; height: auto; background: white; }
figcaption { opacity: .8; }
footer { margin-top: 3rem; opacity: .7; }
";

/// Writes the page as HTML with embedded pictures; it loads no other content
///
/// # Errors
/// When a picture cannot be encoded.
pub fn web_page(results: &Results) -> Result<String, PageError> {
    let mut html = String::from(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" \
         content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n",
    );
    push(
        &mut html,
        format_args!(
            "<title>{TITLE} - pirouette</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{TITLE}</h1>\n"
        ),
    );
    for paragraph in ABOUT {
        push(&mut html, format_args!("<p>{}</p>\n", prose(paragraph)));
    }
    web_table(&mut html, &results.summary());
    for experiment in &results.experiments {
        web_experiment(&mut html, experiment)?;
    }
    push(
        &mut html,
        format_args!(
            "<footer>pirouette {}</footer>\n</body>\n</html>\n",
            env!("CARGO_PKG_VERSION")
        ),
    );
    Ok(html)
}

fn web_experiment(html: &mut String, experiment: &Experiment) -> Result<(), PageError> {
    push(
        html,
        format_args!(
            "<h2 id=\"{}\">{}</h2>\n",
            experiment.name,
            escape_html(experiment.title)
        ),
    );
    for paragraph in &experiment.reading {
        push(html, format_args!("<p>{}</p>\n", prose(paragraph)));
    }
    for table in &experiment.tables {
        web_table(html, table);
    }
    for picture in &experiment.pictures {
        let caption = escape_html(&picture.caption);
        let data = data_uri("image/png", &png(picture)?);
        push(
            html,
            format_args!(
                "<figure><img alt=\"{caption}\" src=\"{data}\">\
                 <figcaption>{caption}</figcaption></figure>\n"
            ),
        );
    }
    Ok(())
}

fn web_table(html: &mut String, table: &Table) {
    push(
        html,
        format_args!(
            "<div class=\"wide\"><table>\n<caption>{}</caption>\n<tr>",
            escape_html(&table.title)
        ),
    );
    let first = table.rows.first();
    for (column, head) in table.columns.iter().enumerate() {
        let number = first.is_some_and(|row| !matches!(row.get(column), Some(Cell::Text(_))));
        let class = if number { " class=\"number\"" } else { "" };
        push(html, format_args!("<th{class}>{}</th>", escape_html(head)));
    }
    html.push_str("</tr>\n");
    for row in &table.rows {
        html.push_str("<tr>");
        for cell in row {
            let class = match cell {
                Cell::Text(_) => "",
                _ => " class=\"number\"",
            };
            push(
                html,
                format_args!("<td{class}>{}</td>", escape_html(&cell.to_string())),
            );
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</table></div>\n");
    for note in &table.notes {
        push(html, format_args!("<p>{}</p>\n", escape_html(note)));
    }
}

fn png(picture: &Picture) -> Result<Vec<u8>, PageError> {
    encode_photo_png(&picture.photo).map_err(|source| PageError::Picture {
        name: picture.name,
        source: source.into(),
    })
}

fn push(text: &mut String, more: std::fmt::Arguments) {
    // Writing to a string cannot fail.
    let _ = text.write_fmt(more);
}

/// Formats a paragraph, with text in backquotes as code
fn prose(text: &str) -> String {
    let mut html = String::new();
    for (index, part) in text.split('`').enumerate() {
        let part = escape_html(part);
        if index % 2 == 1 {
            push(&mut html, format_args!("<code>{part}</code>"));
        } else {
            html.push_str(&part);
        }
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::{Effort, Figure};
    use pirouette_geom::Grid;

    fn results(error_px: f64) -> Results {
        let mut table = Table::new("by <angle>", &["turn", "px"]);
        table
            .rows
            .push(vec![Cell::Text("0°".into()), Cell::Number(0.1234, 2)]);
        Results {
            effort: Effort::Quick,
            experiments: vec![Experiment {
                name: "registration",
                title: "Table 2",
                reading: vec!["Read `so` & so."],
                figures: vec![(Figure::RegistrationMean, error_px)],
                tables: vec![table],
                pictures: vec![Picture {
                    name: "dot",
                    caption: "A \"dot\"".into(),
                    photo: Grid::filled(2, 2, [9, 8, 7]),
                }],
                values: Vec::new(),
            }],
        }
    }

    #[test]
    fn markdown_has_tables_and_links_its_pictures() {
        let MarkdownPage { text, pictures } = markdown(&results(0.1), "pictures").unwrap();
        assert!(
            text.contains("| turn | px |\n| --- | --: |\n| 0° | 0.12 |\n"),
            "{text}"
        );
        assert!(text.contains("](pictures/dot.png)"));
        assert_eq!(pictures.len(), 1);
        assert_eq!(pictures[0].0, "dot.png");
        assert!(pictures[0].1.starts_with(b"\x89PNG"));
    }

    #[test]
    fn the_web_page_is_self_contained_and_escaped() {
        let html = web_page(&results(0.1)).unwrap();
        assert!(html.contains("by &lt;angle&gt;") && html.contains("<code>so</code> &amp; so."));
        assert!(html.contains("src=\"data:image/png;base64,"));
        assert!(!html.contains("http://") && !html.contains("<script"));
    }

    #[test]
    fn missed_goals_are_listed() {
        assert!(results(0.1).shortfalls().is_empty());
        let short = results(0.7).shortfalls();
        assert_eq!(
            short,
            ["Table 2: registration, mean error: 0.700 px, must be at most 0.5 px"]
        );
        assert!(results(f64::NAN).shortfalls().len() == 1);
        assert!(results(0.7).summary().to_string().contains("short"));
    }
}
