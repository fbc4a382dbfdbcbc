//! `pirouette compare`: the changes from one result to another.

use anyhow::{Result, bail};
use pirouette_files::compare::{Change, ComparedResult, change_colors, compare};
use pirouette_files::formats::mesh::{BodyMesh, MeshFormat};
use pirouette_files::sink::{make_folder, write_atomic};
use serde_json::{Value, json};

use crate::args::CompareArgs;
use crate::output::Output;

/// Compares two result folders
pub fn run(args: &CompareArgs, output: Output) -> Result<()> {
    let first = ComparedResult::read(&args.first)?;
    let second = ComparedResult::read(&args.second)?;
    let changes = compare(&first, &second);
    if changes.is_empty() {
        bail!(
            "{} and {} have no measure in common",
            args.first.display(),
            args.second.display()
        );
    }
    let value = json!({
        "first": args.first,
        "second": args.second,
        "changes": changes.iter().map(Change::to_json).collect::<Vec<Value>>(),
    });
    if let Some(folder) = &args.out {
        make_folder(folder)?;
        if let (Some(before), Some(after)) = (&first.body, &second.body) {
            let colors = change_colors(before, after);
            let body = BodyMesh {
                colors: Some(&colors),
                ..BodyMesh::from(after)
            };
            write_atomic(&folder.join("changes.ply"), &MeshFormat::Ply.write(body))?;
        }
        let text = format!("{value:#}\n");
        write_atomic(&folder.join("compare.json"), text.as_bytes())?;
    }
    output.done(&table(&changes), || {
        let mut line = json!({ "ok": true });
        if let (Value::Object(line), Value::Object(value)) = (&mut line, value) {
            line.extend(value);
        }
        line
    })
}

/// Formats the changes as text
fn table(changes: &[Change]) -> String {
    let head = format!("{:<24}{:>8}{:>8}{:>14}", "mm", "first", "second", "change");
    let rows = changes.iter().map(|change| {
        let name = change.measure.name().replace('_', " ");
        let mark = if change.is_beyond_chance() { " *" } else { "" };
        format!(
            "{name:<24}{:>8.0}{:>8.0}{:>+8.0} ± {:<3.0}{mark}",
            change.first_mm, change.second_mm, change.difference_mm, change.sd_mm
        )
    });
    let rows: Vec<String> = std::iter::once(head).chain(rows).collect();
    let text: Vec<&str> = rows.iter().map(|row| row.trim_end()).collect();
    text.join("\n")
}
