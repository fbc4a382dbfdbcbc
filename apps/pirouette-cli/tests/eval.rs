//! `eval`: studies and scores.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Folders, person, pirouette, text};
use pirouette_files::formats::photo::encode_mask;

/// Creates a scan folder with the true silhouettes
fn with_truth() -> Folders {
    let folders = Folders::with_views(4);
    let truth = folders.scan().join("truth");
    std::fs::create_dir(&truth).unwrap();
    let person = person();
    for (view, mask) in person.scan.views.iter().zip(&person.truth.silhouettes) {
        let png = encode_mask(mask).unwrap();
        std::fs::write(truth.join(format!("{}_mask.png", view.name)), png).unwrap();
    }
    folders
}

#[test]
fn a_scan_with_truth_is_scored_and_kept_results_score_equally() {
    let folders = with_truth();
    let (scan, out) = (folders.scan(), folders.out());
    let scan_and_score = ["eval", "scans", text(&scan), "-o", text(&out), "--json"];
    let found = pirouette(&scan_and_score).exits_with(0).json_line();
    let iou = found["scans"][0]["seg_iou"].as_f64().unwrap();
    assert!(iou > 0.9, "{found}");
    let mut again = scan_and_score.to_vec();
    again.push("--keep");
    assert_eq!(pirouette(&again).exits_with(0).json_line(), found);
}

#[test]
fn missing_results_cannot_be_scored() {
    let folders = with_truth();
    let (scan, out) = (folders.scan(), folders.out());
    let args = ["eval", "scans", text(&scan), "-o", text(&out), "--keep"];
    let run = pirouette(&args).exits_with(1);
    assert!(run.stderr().contains("no results in"), "{}", run.stderr());
}

#[test]
fn photos_with_truth_are_segmented_and_scored() {
    let folders = with_truth();
    let scan = folders.scan();
    let run = pirouette(&["eval", "photos", text(&scan)]).exits_with(0);
    assert!(run.stdout().contains("median"), "{}", run.stdout());
}

#[test]
fn folders_without_truth_are_rejected() {
    let folders = Folders::with_views(3);
    let run = pirouette(&["eval", "photos", text(&folders.scan())]).exits_with(1);
    assert!(run.stderr().contains("no folder truth"), "{}", run.stderr());
}

#[test]
fn a_study_without_people_fails_and_invalid_usage_exits_with_2() {
    let args = ["eval", "bodies", "--people", "0", "--photo-people", "0"];
    pirouette(&args).exits_with(1);
    pirouette(&["eval", "faults", "--people", "0"]).exits_with(1);
    pirouette(&["eval", "faults", "--views", "3"]).exits_with(2);
    pirouette(&["eval", "faults", "--only", "weather"]).exits_with(2);
    pirouette(&["eval", "--only", "everything"]).exits_with(2);
    pirouette(&["eval", "--quick", "bodies"]).exits_with(2);
    pirouette(&["eval", "bodies", "--views", "2"]).exits_with(2);
    pirouette(&["eval", "bodies", "--noise", "-1"]).exits_with(2);
}

#[test]
fn a_published_experiment_is_reproduced_checked_and_written() {
    let folders = Folders::with_views(3);
    let file = folders.scan().join("results.md");
    let html = folders.scan().join("results.html");
    let args = [
        "eval",
        "--quick",
        "--check",
        "--json",
        "--only",
        "refinement",
        "--markdown",
        text(&file),
        "--html",
        text(&html),
    ];
    let found = pirouette(&args).exits_with(0).json_line();
    assert_eq!(found["short"].as_array().unwrap().len(), 0, "{found}");
    assert_eq!(found["figures"].as_array().unwrap().len(), 2);
    let page = std::fs::read_to_string(&file).unwrap();
    assert!(page.contains("](results/refinement-0.png)"), "{page}");
    assert!(file.with_extension("").join("refinement-0.png").is_file());
    assert!(
        std::fs::read_to_string(&html)
            .unwrap()
            .ends_with("</html>\n")
    );
}
