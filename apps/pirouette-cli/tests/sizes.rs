//! Sizes, charts, exports and scales.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Folders, pirouette, text};
use serde_json::json;

fn measurements(bust_mm: f64, sd_mm: f64) -> String {
    json!({
        "measurements_mm": { "bust_girth": bust_mm, "waist_girth": 860.0, "hip_girth": null },
        "details": { "bust_girth": { "sd_mm": sd_mm }, "waist_girth": { "sd_mm": 10.0 } },
        "unit": "mm",
    })
    .to_string()
}

#[test]
fn sizes_of_a_result_file_may_be_not_sure() {
    let folders = Folders::empty();
    let file = folders.write("measurements.json", measurements(980.0, 15.0));
    let run = pirouette(&["size", text(&file), "--sex", "male"]).exits_with(0);
    let stdout = run.stdout();
    let line = |chart: &str| stdout.lines().find(|l| l.starts_with(chart)).unwrap();
    assert!(
        line("EN 13402-3, men, letters, tops").contains(" M ("),
        "{stdout}"
    );
    assert!(
        line("EN 13402-3, men, shirts by neck").contains("not sure"),
        "{stdout}"
    );
    assert!(!stdout.contains("women"), "{stdout}");
    let line = pirouette(&["--json", "size", text(&file)])
        .exits_with(0)
        .json_line();
    let sizes = line["sizes"].as_array().unwrap();
    assert!(sizes.iter().any(|s| s["sex"] == "female"));
    assert!(sizes.iter().any(|s| s["sizes"] == json!(["M"])));
}

#[test]
fn sizes_by_estimates_below_clothes_say_so() {
    let folders = Folders::empty();
    let mut found: serde_json::Value = serde_json::from_str(&measurements(980.0, 40.0)).unwrap();
    let file = folders.write("measurements.json", found.to_string());
    let stdout = pirouette(&["size", text(&file)]).exits_with(0).stdout();
    assert!(!stdout.contains("clothes:"), "{stdout}");
    found["details"]["bust_girth"]["method"] = json!("below_clothes");
    let file = folders.write("measurements.json", found.to_string());
    let stdout = pirouette(&["size", text(&file)]).exits_with(0).stdout();
    let last = stdout.trim_end().lines().last().unwrap();
    assert!(
        last.contains("through clothes") && last.ends_with(": bust girth ± 40 mm"),
        "{stdout}"
    );
}

#[test]
fn a_custom_chart_replaces_the_built_in_ones() {
    let folders = Folders::empty();
    let file = folders.write("measurements.json", measurements(980.0, 15.0));
    let chart = folders.write(
        "shop.toml",
        "[[chart]]\nname = \"ours\"\nprimary = \"bust_girth\"\n\
         size = [{ name = \"one\", bust_girth = [80, 95] }, { name = \"two\", bust_girth = [95, 110] }]\n",
    );
    let run = pirouette(&["size", text(&file), "--chart", text(&chart)]).exits_with(0);
    assert!(run.stdout().contains("two (98 %)"), "{}", run.stdout());
    let broken = folders.write("broken.toml", "[[chart]]\nname = \"ours\"\n");
    let run = pirouette(&["size", text(&file), "--chart", text(&broken)]).exits_with(1);
    assert!(run.stderr().contains("broken.toml"), "{}", run.stderr());
    assert_eq!(run.stderr().lines().count(), 1);
}

#[test]
fn an_invalid_result_is_rejected_in_one_line() {
    let folders = Folders::empty();
    for (name, content) in [
        ("a.json", "{"),
        ("b.json", "{}"),
        (
            "c.json",
            "{ \"measurements_mm\": {}, \"unit\": \"stature\" }",
        ),
    ] {
        let file = folders.write(name, content);
        let run = pirouette(&["size", text(&file)]).exits_with(1);
        assert_eq!(run.stderr().lines().count(), 1, "{}", run.stderr());
        assert!(run.stderr().contains(name), "{}", run.stderr());
    }
    let run = pirouette(&["size", text(&folders.path("nothing"))]).exits_with(1);
    assert!(run.stderr().contains("result folder"), "{}", run.stderr());
}

#[test]
fn without_a_scale_no_length_is_in_mm_and_a_missing_card_is_an_error() {
    let folders = Folders::with_views(3);
    let manifest = folders.scan().join("scan.json");
    let mut scan: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&manifest).unwrap()).unwrap();
    scan.as_object_mut().unwrap().remove("subject");
    std::fs::write(&manifest, scan.to_string()).unwrap();
    folders
        .run("scan", &["--export", "csv,seamly2d"])
        .exits_with(0);
    let found = folders.json("measurements.json");
    assert_eq!(found["unit"], "stature");
    assert!(found["measurements_mm"]["waist_girth"].is_null());
    let waist = found["measurements_per_stature"]["waist_girth"]
        .as_f64()
        .unwrap();
    assert!((0.3..0.8).contains(&waist), "{waist}");
    assert!(folders.out().join("tapes.jpg").is_file());
    let vit = std::fs::read_to_string(folders.out().join("measurements.vit")).unwrap();
    assert!(vit.contains("<unit>cm</unit>") && !vit.contains("waist_circ"));
    let run = folders.run("scan", &["--scale", "card"]).exits_with(1);
    assert!(run.stderr().contains("no ID-1 card"), "{}", run.stderr());
}
