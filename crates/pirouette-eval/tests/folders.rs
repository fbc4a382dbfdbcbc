//! Scores of folders whose errors are known.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::fs;
use std::path::Path;

use pirouette::pipeline::CancelToken;
use pirouette_eval::folders::{
    ScoreError, photo_table, scan_table, score_photos, score_scan, with_truth,
};
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::formats::photo::encode_mask;
use pirouette_files::scan_folder::write_scan;
use pirouette_geom::Mask;
use pirouette_synthetic::people;

/// A rectangle
fn mask(x0: usize, width: usize) -> Mask {
    Mask::from_fn(80, 100, |x, y| {
        (x0..x0 + width).contains(&x) && (10..90).contains(&y)
    })
}

fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

fn write_mask(path: &Path, mask: &Mask) {
    write(path, encode_mask(mask).unwrap());
}

#[test]
fn a_result_is_scored_by_definition() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, out) = (folder.path().join("ann"), folder.path().join("out"));
    let truth = scan.join("truth");
    for stem in ["000", "001"] {
        write_mask(&truth.join(format!("{stem}_mask.png")), &mask(20, 40));
        write_mask(&truth.join(format!("{stem}_canonical.png")), &mask(30, 40));
    }
    // The first view is found by three quarters, the second is lost.
    write_mask(&out.join("views/000/mask.png"), &mask(20, 30));
    write_mask(&out.join("views/000/normalized.png"), &mask(20, 40));
    write(
        &truth.join("truth.json"),
        r#"{ "measurements_mm": { "stature": 1600, "neck_girth": 300 } }"#,
    );
    write(
        &out.join("measurements.json"),
        r#"{ "measurements_mm": { "stature": 1604.5, "neck_girth": null } }"#,
    );
    let score = score_scan(&scan, &out).unwrap();
    assert_eq!(score.scan, "ann");
    assert_eq!(score.get("seg_iou"), Some(0.375));
    assert_eq!(score.get("seg_worst"), Some(0.0));
    assert_eq!(score.get("norm_iou"), Some(0.5));
    assert_eq!(score.get("raw_iou_1"), Some(1.0));
    assert_eq!(score.get("measure_stature_mm"), Some(4.5));
    assert_eq!(score.get("measure_neck_girth_mm"), None);
    assert_eq!(score.get("hull_mean_mm"), None);
    let table = scan_table(std::slice::from_ref(&score)).to_string();
    assert!(table.contains("measure_stature_mm     4.5"), "{table}");
    assert_eq!(score.to_json()["seg_iou"], 0.375);
}

#[test]
fn the_true_body_has_no_error() {
    let person = people::turning_woman(3);
    let folder = tempfile::tempdir().unwrap();
    let (scan, out) = (folder.path().join("scan"), folder.path().join("out"));
    write_mask(&scan.join("truth/000_mask.png"), &mask(20, 40));
    let body = &person.truth.body;
    write(&scan.join("truth/body.ply"), MeshFormat::Ply.write(body));
    write(&out.join("body.obj"), MeshFormat::Obj.write(body));
    let height = 950.0;
    let girth = pirouette_eval::score::girth::trunk_girth(body, height).unwrap();
    write(
        &scan.join("truth/truth.json"),
        format!(
            r#"{{ "measurements_mm": {{ "waist_height": {height}, "waist_girth": {} }} }}"#,
            girth / 1.1
        ),
    );
    let score = score_scan(&scan, &out).unwrap();
    assert!(score.get("hull_mean_mm").unwrap() < 0.1);
    assert!((score.get("hull_volume_ratio").unwrap() - 1.0).abs() < 1e-4);
    assert!((score.get("hull_stature_mm").unwrap() - 1650.0).abs() < 0.1);
    assert!((score.get("girth_waist_pct").unwrap() - 10.0).abs() < 0.1);
    assert_eq!(score.get("seg_iou"), None);
}

#[test]
fn folders_of_folders_are_looked_into_and_others_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["b", "a"] {
        fs::create_dir_all(folder.path().join(name).join("truth")).unwrap();
    }
    fs::create_dir_all(folder.path().join("c")).unwrap();
    let all = [folder.path().to_owned()];
    let found = with_truth(&all).unwrap();
    assert_eq!(found, ["a", "b"].map(|name| folder.path().join(name)));
    let empty = [folder.path().join("c")];
    assert!(matches!(
        with_truth(&empty),
        Err(ScoreError::NoTruth { .. })
    ));
}

#[test]
fn single_photos_are_segmented_and_scored_each_for_itself() {
    let mut person = people::turning_woman(4);
    person.scan.views.truncate(2);
    let folder = tempfile::tempdir().unwrap();
    write_scan(folder.path(), &person.scan).unwrap();
    for (view, silhouette) in person.scan.views.iter().zip(&person.truth.silhouettes) {
        let name = format!("truth/{}_mask.png", view.name);
        write_mask(&folder.path().join(name), silhouette);
    }
    // A photo that is not there is a photo that was not segmented.
    write_mask(&folder.path().join("truth/009_mask.png"), &mask(20, 40));
    let folders = [folder.path().to_owned()];
    let scores = score_photos(&folders, &CancelToken::default(), &mut |_| {}).unwrap();
    let ious: Vec<f64> = scores.iter().map(|score| score.iou).collect();
    assert!(ious[0] > 0.9 && ious[1] > 0.9, "{ious:?}");
    assert_eq!(ious[2], 0.0);
    let table = photo_table(&scores).to_json();
    assert_eq!(table["rows"][0]["photos"], 3.0);
}
