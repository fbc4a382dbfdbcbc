//! The page `report.html`: all results in one self-contained file.
//!
//! Pictures are embedded, styles are inline, there are no scripts; the page's security policy forbids loading other
//! content. All text is escaped, regardless of its source.

use super::turn_curve::{TimedTurn, turn_curve};
use std::fmt::{Display, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use pirouette::measure::{Measure, Measured, Method};
use pirouette_body::Camera;

/// Content of the page; empty parts are omitted
#[derive(Debug)]
pub(crate) struct Page<'a> {
    /// Title, for instance the name of the scan
    pub title: &'a str,
    /// Name and value, for instance the number of usable views
    pub facts: Vec<(&'static str, String)>,
    /// Why there is no body
    pub refusal: Option<String>,
    /// Automatic corrections and excluded views
    pub warnings: Vec<String>,
    /// In the order of the table
    pub measurements: Vec<(Measure, Measured)>,
    /// Verdict of each size chart
    pub sizes: Vec<(String, String)>,
    /// The body with its tapes, as a JPEG file
    pub tapes: Option<Vec<u8>>,
    /// The contact sheet, as a JPEG file
    pub contact_sheet: Option<Vec<u8>>,
    /// Differences between the photos and the fitted body, as a JPEG file
    pub residuals: Option<Vec<u8>>,
    /// One picture per view
    /// Times, in s, and turn angles in the video, in degrees
    pub turn: &'a [(f64, f64)],
    pub views: Vec<PageView<'a>>,
    /// The camera of the results
    pub camera: Option<&'a Camera>,
    /// Duration of each stage
    pub seconds: Vec<(&'static str, f64)>,
}

/// One view on the page
#[derive(Debug)]
pub(crate) struct PageView<'a> {
    pub name: &'a str,
    /// Time stamp in the video, in s
    pub time_s: Option<f64>,
    pub turn_degrees: f64,
    /// Standard deviation of the turn, in degrees
    pub turn_sd_degrees: Option<f64>,
    /// As a JPEG file
    pub overlay: Vec<u8>,
}

const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; }
h2 { margin: 2.2rem 0 .6rem; }
table { border-collapse: collapse; }
th, td { padding: .2rem .8rem; border-bottom: 1px solid #8885; text-align: left; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
.refusal { border-left: 4px solid #d33; padding-left: .6rem; font-weight: bold; }
.warnings li { border-left: 4px solid #e6a100; padding-left: .6rem; margin: .3rem 0; list-style: none; }
.warnings ul { padding: 0; }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem; }
figure { margin: 0; }
img { width: 100%; height: auto; }
footer { margin-top: 3rem; opacity: .7; }
";

/// Writes the page
pub(crate) fn write_page(page: &Page) -> String {
    let mut html = String::new();
    let title = escape_html(page.title);
    html.push_str("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    html.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    html.push_str(
        "<meta http-equiv=\"Content-Security-Policy\" \
         content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n",
    );
    add(
        &mut html,
        format_args!("<title>{title} - pirouette</title>\n"),
    );
    add(
        &mut html,
        format_args!("<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"),
    );
    if !page.facts.is_empty() {
        let facts = page.facts.iter();
        let facts: Vec<String> = facts
            .map(|(name, value)| format!("{name}: {value}"))
            .collect();
        let line = escape_html(&facts.join(" · "));
        add(&mut html, format_args!("<p>{line}</p>\n"));
    }
    if let Some(refusal) = &page.refusal {
        let text = escape_html(refusal);
        add(&mut html, format_args!("<p class=\"refusal\">{text}</p>\n"));
    }
    add_warnings(&mut html, &page.warnings);
    add_measurements(&mut html, &page.measurements);
    if let Some(tapes) = &page.tapes {
        html.push_str("<div class=\"wide\">");
        add_picture(&mut html, "the body with all tapes, front and side", tapes);
        html.push_str("</div>\n");
    }
    add_sizes(&mut html, &page.sizes);
    if let Some(sheet) = &page.contact_sheet {
        html.push_str("<h2>All views</h2>\n<div class=\"wide\">");
        add_picture(&mut html, "all views at a glance", sheet);
        html.push_str("</div>\n");
    }
    if let Some(residuals) = &page.residuals {
        html.push_str("<h2>Differences between the photos and the body</h2>\n<div class=\"wide\">");
        let what = "distances between the outlines, in mm, and numbers of views that see each part";
        add_picture(&mut html, what, residuals);
        html.push_str("</div>\n");
    }
    add_turn(&mut html, page);
    add_views(&mut html, &page.views);
    if let Some(camera) = page.camera {
        add_camera(&mut html, camera);
    }
    add_seconds(&mut html, &page.seconds);
    add(
        &mut html,
        format_args!(
            "<footer>pirouette {}</footer>\n</body>\n</html>\n",
            env!("CARGO_PKG_VERSION")
        ),
    );
    html
}

fn add(html: &mut String, text: std::fmt::Arguments) {
    // Writing to a string cannot fail.
    let _ = html.write_fmt(text);
}

/// Encodes a picture as a data URI, for pages without other files
pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    format!("data:{media_type};base64,{}", STANDARD.encode(bytes))
}

/// Escapes a text for HTML, between tags and in quoted attributes
pub fn escape_html(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            c => safe.push(c),
        }
    }
    safe
}

fn add_picture(html: &mut String, what: &str, jpeg: &[u8]) {
    add(
        html,
        format_args!(
            "<img alt=\"{}\" src=\"{}\">",
            escape_html(what),
            data_uri("image/jpeg", jpeg)
        ),
    );
}

fn add_warnings(html: &mut String, warnings: &[String]) {
    if warnings.is_empty() {
        return;
    }
    html.push_str("<section class=\"warnings\">\n<h2>Warnings</h2>\n<ul>\n");
    for warning in warnings {
        add(html, format_args!("<li>{}</li>\n", escape_html(warning)));
    }
    html.push_str("</ul>\n</section>\n");
}

fn add_measurements(html: &mut String, measurements: &[(Measure, Measured)]) {
    if measurements.is_empty() {
        return;
    }
    let columns = [
        "mm",
        "left",
        "right",
        "above the floor",
        "standard deviation",
        "views",
    ];
    html.push_str("<h2>Measurements</h2>\n<div class=\"wide\"><table>\n<tr><th></th>");
    for column in columns {
        add(html, format_args!("<th class=\"number\">{column}</th>"));
    }
    html.push_str("<th>from</th></tr>\n");
    for (measure, measured) in measurements {
        let name = measure.name().replace('_', " ");
        add(html, format_args!("<tr><th>{}</th>", escape_html(&name)));
        let in_mm = |value: Option<f64>| value.map(|value_mm| format!("{value_mm:.0}"));
        add_number(html, in_mm(measured.value_mm.ok()));
        for value in [measured.left_mm, measured.right_mm, measured.level_mm] {
            add_number(html, in_mm(value));
        }
        add_number(html, measured.sd_mm.map(|sd_mm| format!("± {sd_mm:.1}")));
        add_number(html, measured.view_count);
        let from = match measured.value_mm {
            Ok(_) => method_text(measured.method).to_owned(),
            Err(why) => why.to_string(),
        };
        add(html, format_args!("<td>{}</td></tr>\n", escape_html(&from)));
    }
    html.push_str("</table></div>\n");
}

fn add_sizes(html: &mut String, sizes: &[(String, String)]) {
    if sizes.is_empty() {
        return;
    }
    html.push_str("<h2>Sizes</h2>\n<table>\n");
    for (chart, verdict) in sizes {
        let (chart, verdict) = (escape_html(chart), escape_html(verdict));
        add(
            html,
            format_args!("<tr><th>{chart}</th><td>{verdict}</td></tr>\n"),
        );
    }
    html.push_str("</table>\n");
}

/// Adds a cell with a number, or with a dash if there is none
fn add_number(html: &mut String, number: Option<impl Display>) {
    match number {
        Some(number) => add(html, format_args!("<td class=\"number\">{number}</td>")),
        None => html.push_str("<td class=\"number\">-</td>"),
    }
}

fn method_text(method: Method) -> &'static str {
    match method {
        Method::Given => "given",
        Method::Scale => "the scale",
        Method::WithStatistics => "photos and statistics of a survey",
        Method::BelowClothes => "below clothes or hair, by statistics of a survey",
        Method::SupportLines => "outlines of several views",
        Method::BodyTape => "section of the body",
        Method::Combined => "outlines and section of the body",
        Method::HullSection => "section of the hull",
        Method::Body => "the body",
        Method::Avatar => "the person's skeleton",
    }
}

/// Adds the turn over time in a video
fn add_turn(html: &mut String, page: &Page) {
    let timed = page.views.iter().filter_map(|view| {
        Some(TimedTurn {
            time_s: view.time_s?,
            turn_degrees: view.turn_degrees,
        })
    });
    if let Some(svg) = turn_curve(page.turn, &timed.collect::<Vec<_>>()) {
        add(
            html,
            format_args!("<h2>Turn in the video</h2>\n<div class=\"wide\">{svg}</div>\n"),
        );
    }
}

fn add_views(html: &mut String, views: &[PageView]) {
    if views.is_empty() {
        return;
    }
    html.push_str("<h2>Photos</h2>\n<div class=\"views\">\n");
    for view in views {
        let sd = view
            .turn_sd_degrees
            .map_or_else(String::new, |sd| format!(" ± {sd:.1}°"));
        let name = format!("{}, {:.0}°{sd}", view.name, view.turn_degrees);
        html.push_str("<figure>");
        add_picture(html, &name, &view.overlay);
        add(
            html,
            format_args!("<figcaption>{}</figcaption></figure>\n", escape_html(&name)),
        );
    }
    html.push_str("</div>\n");
}

fn add_camera(html: &mut String, camera: &Camera) {
    html.push_str("<h2>Camera</h2>\n<table>\n");
    let vertical_fov_degrees = camera.vertical_fov_radians.to_degrees();
    for (name, value) in [
        (
            "vertical field of view",
            format!("{vertical_fov_degrees:.1}°"),
        ),
        (
            "height above the floor",
            format!("{:.0} mm", camera.height_mm),
        ),
        (
            "distance to the turning axis",
            format!("{:.0} mm", camera.distance_mm),
        ),
        (
            "pitch, positive looks down",
            format!("{:.1}°", camera.pitch_radians.to_degrees()),
        ),
    ] {
        add(
            html,
            format_args!("<tr><th>{name}</th><td class=\"number\">{value}</td></tr>\n"),
        );
    }
    html.push_str("</table>\n");
}

fn add_seconds(html: &mut String, seconds: &[(&'static str, f64)]) {
    if seconds.is_empty() {
        return;
    }
    html.push_str("<h2>Seconds per stage</h2>\n<table>\n");
    let total = ("all", seconds.iter().map(|(_, time)| time).sum());
    for (stage, time) in seconds.iter().chain([&total]) {
        add(
            html,
            format_args!("<tr><th>{stage}</th><td class=\"number\">{time:.2}</td></tr>\n"),
        );
    }
    html.push_str("</table>\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette::measure::Unavailable;

    fn measured(value_mm: Result<f64, Unavailable>) -> Measured {
        Measured {
            value_mm,
            method: Method::SupportLines,
            left_mm: None,
            right_mm: Some(361.4),
            level_mm: None,
            sd_mm: Some(2.25),
            scale_sd_mm: None,
            view_count: Some(7),
            lines: None,
            body: None,
            contradicted: false,
            pixels: None,
            prior: None,
        }
    }

    fn page() -> Page<'static> {
        Page {
            title: "anna & <ben>",
            facts: vec![("views", "2 of 3".into())],
            refusal: Some("no body: <b>".into()),
            warnings: vec!["view \"x\" is rejected: <script>alert('hi')</script>".into()],
            measurements: vec![
                (Measure::CalfGirth, measured(Ok(360.6))),
                (Measure::HipGirth, measured(Err(Unavailable::Hidden))),
            ],
            sizes: vec![("shop <b>".into(), "M (80 %)".into())],
            tapes: None,
            contact_sheet: Some(vec![0xff, 0xd8, 0xff]),
            residuals: None,
            turn: &[],
            views: vec![PageView {
                name: "a\" onerror=\"b",
                time_s: None,
                turn_degrees: 45.2,
                turn_sd_degrees: Some(1.23),
                overlay: vec![1, 2],
            }],
            camera: None,
            seconds: vec![("load", 0.25), ("segment", 1.5)],
        }
    }

    #[test]
    fn texts_are_escaped() {
        let html = write_page(&page());
        assert!(html.contains("<h1>anna &amp; &lt;ben&gt;</h1>"), "{html}");
        assert!(html.contains("&lt;script&gt;alert(&#39;hi&#39;)"), "{html}");
        assert!(
            html.contains("alt=\"a&quot; onerror=&quot;b, 45° ± 1.2°\""),
            "{html}"
        );
        for tag in ["<script", "<ben", "onerror=\"b"] {
            assert!(!html.contains(tag), "{tag}");
        }
    }

    #[test]
    fn the_page_is_self_contained() {
        let html = write_page(&page());
        assert!(
            html.contains("src=\"data:image/jpeg;base64,/9j/\""),
            "{html}"
        );
        assert!(html.contains("default-src 'none'"));
        for outside in [
            "http:", "https:", "//", "url(", "@import", "<link", "<script",
        ] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn values_and_reasons_of_missing_ones_are_shown() {
        let html = write_page(&page());
        for expected in [
            "<th>calf girth</th><td class=\"number\">361</td><td class=\"number\">-</td>",
            "± 2.2",
            "too few views show it",
            "<th>all</th><td class=\"number\">1.75</td>",
            "views: 2 of 3",
            "<p class=\"refusal\">no body: &lt;b&gt;</p>",
            "<th>shop &lt;b&gt;</th><td>M (80 %)</td>",
        ] {
            assert!(html.contains(expected), "{expected} in {html}");
        }
        assert!(!html.contains("Camera"));
    }

    #[test]
    fn an_empty_page_is_valid() {
        let html = write_page(&Page {
            title: "",
            facts: Vec::new(),
            refusal: None,
            warnings: Vec::new(),
            measurements: Vec::new(),
            sizes: Vec::new(),
            tapes: None,
            contact_sheet: None,
            residuals: None,
            turn: &[],
            views: Vec::new(),
            camera: None,
            seconds: Vec::new(),
        });
        assert!(html.starts_with("<!doctype html>") && html.ends_with("</html>\n"));
        assert!(!html.contains("<h2>"), "{html}");
    }
}
