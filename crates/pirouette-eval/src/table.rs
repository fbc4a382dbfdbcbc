//! Tables, written as aligned text and as JSON.

use std::fmt;

use serde_json::{Map, Value, json};

/// A table; the first cells of a row name it
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Title
    pub title: String,
    /// Column headings
    pub columns: Vec<String>,
    /// Rows, with one cell per column
    pub rows: Vec<Vec<Cell>>,
    /// Notes below the table
    pub notes: Vec<String>,
}

/// One cell
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A text
    Text(String),
    /// A number and its number of decimals
    Number(f64, usize),
    /// Mean and standard deviation
    Spread(Spread),
    /// No value
    Missing,
}

/// Mean and standard deviation
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean
    pub mean: f64,
    /// Standard deviation around it
    pub sd: f64,
}

impl Spread {
    /// Computes the spread of values; `None` without values
    pub fn of(values: &[f64]) -> Option<Self> {
        let mean = mean(values)?;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        Some(Self {
            mean,
            sd: variance.sqrt(),
        })
    }
}

/// Returns the mean of values; `None` without values
pub(crate) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Returns a percentile, given as a share, with linear interpolation; `None` without values
pub(crate) fn percentile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = share * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + (high - low) * at.fract())
}

/// Returns a text with its first letter in upper case
fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

impl Cell {
    /// Creates a cell with a number, or a missing one
    pub fn number(value: Option<f64>, decimals: usize) -> Self {
        value.map_or(Cell::Missing, |value| Cell::Number(value, decimals))
    }

    /// Creates a cell with a spread, with the number if it is a single one, or a missing one
    pub fn spread(values: &[f64]) -> Self {
        match values {
            [single] => Cell::Number(*single, 1),
            _ => Spread::of(values).map_or(Cell::Missing, Cell::Spread),
        }
    }

    fn value(&self) -> Value {
        let rounded = |value: f64| json!((value * 1e4).round() / 1e4);
        match self {
            Cell::Text(text) => json!(text),
            Cell::Number(value, _) => rounded(*value),
            Cell::Spread(Spread { mean, sd }) => {
                json!({ "mean": rounded(*mean), "sd": rounded(*sd) })
            }
            Cell::Missing => Value::Null,
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cell::Text(text) => f.write_str(text),
            Cell::Number(value, decimals) => write!(f, "{value:.decimals$}"),
            Cell::Spread(Spread { mean, sd }) => write!(f, "{mean:+.1} ± {sd:.1}"),
            Cell::Missing => f.write_str("-"),
        }
    }
}

impl Table {
    /// Creates an empty table
    pub fn new(title: impl Into<String>, columns: &[&str]) -> Self {
        Self {
            title: title.into(),
            columns: columns.iter().map(|&c| c.to_owned()).collect(),
            rows: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Returns the rows as JSON objects, keyed by the column headings in snake case
    pub fn to_json(&self) -> Value {
        let keys: Vec<String> = self.columns.iter().map(|c| c.replace(' ', "_")).collect();
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                let cells = keys.iter().cloned().zip(row.iter().map(Cell::value));
                Value::Object(cells.collect::<Map<_, _>>())
            })
            .collect();
        json!({ "title": self.title, "rows": rows, "notes": self.notes })
    }

    /// Returns heading, columns and rows in Markdown, without notes
    pub fn to_section(&self) -> String {
        format!("## {}\n\n{}", capitalized(&self.title), self.to_markdown())
    }

    /// Returns the columns and rows in Markdown, without title and notes
    pub fn to_markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let mut text = line(&self.columns);
        text.push_str(&line(&vec!["---".to_owned(); self.columns.len()]));
        for row in &self.rows {
            text.push_str(&line(&row.iter().map(Cell::to_string).collect::<Vec<_>>()));
        }
        text
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.title)?;
        let mut lines: Vec<Vec<String>> = vec![self.columns.clone()];
        let rows = self.rows.iter();
        lines.extend(rows.map(|row| row.iter().map(Cell::to_string).collect()));
        let width = |column: usize| {
            let cells = lines.iter().filter_map(|line| line.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        // Text is left-aligned, numbers are right-aligned.
        let is_text = |column: usize| {
            let mut cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.any(|cell| matches!(cell, Cell::Text(_)))
        };
        for line in &lines {
            let mut text = String::new();
            for (column, (cell, &width)) in line.iter().zip(&widths).enumerate() {
                text.push_str(&match is_text(column) {
                    true => format!("{cell:<width$}  "),
                    false => format!("{cell:>width$}  "),
                });
            }
            write!(f, "\n{}", text.trim_end())?;
        }
        for note in &self.notes {
            write!(f, "\n{note}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new("heights", &["who", "mean mm", "error %"]);
        table.rows.push(vec![
            Cell::Text("ann".into()),
            Cell::Number(1600.26, 1),
            Cell::spread(&[1.0, 3.0]),
        ]);
        table.rows.push(vec![
            Cell::Text("b".into()),
            Cell::Number(9.0, 1),
            Cell::spread(&[]),
        ]);
        table
    }

    #[test]
    fn text_is_left_aligned_and_numbers_right() {
        let expected = "heights
who  mean mm     error %
ann   1600.3  +2.0 ± 1.0
b        9.0           -";
        assert_eq!(table().to_string(), expected);
    }

    #[test]
    fn markdown_has_a_line_for_each_row() {
        let expected = "| who | mean mm | error % |
| --- | --- | --- |
| ann | 1600.3 | +2.0 ± 1.0 |
| b | 9.0 | - |
";
        assert_eq!(table().to_markdown(), expected);
    }

    #[test]
    fn json_rows_are_keyed_by_column() {
        let value = table().to_json();
        assert_eq!(value["rows"][0]["mean_mm"], 1600.26);
        assert_eq!(value["rows"][0]["error_%"]["sd"], 1.0);
        assert!(value["rows"][1]["error_%"].is_null());
    }

    #[test]
    fn percentiles_are_interpolated() {
        assert_eq!(percentile(&[3.0, 1.0], 0.5), Some(2.0));
        assert_eq!(percentile(&[3.0, 1.0, 7.0], 1.0), Some(7.0));
        assert_eq!(percentile(&[], 0.5), None);
    }
}
