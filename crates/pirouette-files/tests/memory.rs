//! Results in memory and in a folder are the same.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use pirouette::pipeline::{CancelToken, Config, Goal, Method, Report, run};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::results::{ResultOptions, make_artifacts, write_results};
use pirouette_files::scan_folder::{LoadOptions, load_scan, write_scan};
use pirouette_synthetic::people::turning_woman;

fn files_below(folder: &Path, root: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files_below(&path, root, found);
        } else {
            let parts = path
                .strip_prefix(root)
                .expect("below the root")
                .components();
            let names: Vec<_> = parts
                .map(|p| p.as_os_str().to_str().expect("a UTF-8 name"))
                .collect();
            found.insert(names.join("/"), fs::read(&path).expect("a file"));
        }
    }
}

#[test]
fn artifacts_in_memory_are_the_files_of_the_result_folder() {
    let scan_folder = tempfile::tempdir().unwrap();
    write_scan(scan_folder.path(), &turning_woman(4).scan).unwrap();
    let loaded = load_scan(scan_folder.path(), &LoadOptions::default()).unwrap();
    let config = Config::new(Goal::Measure, Method::Fit);
    let cancel = CancelToken::default();
    let report: Report = run(&loaded.scan, &config, &cancel, &mut |_| {}).unwrap();
    let charts = built_in_charts();
    let options = ResultOptions {
        formats: &[MeshFormat::Ply, MeshFormat::Glb],
        page_title: Some("Anna"),
        charts: &charts,
    };
    let artifacts = make_artifacts(&loaded, 0.5, &report, &options).unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_results(folder.path(), &loaded, 0.5, &report, &options).unwrap();
    let mut written = BTreeMap::new();
    files_below(folder.path(), folder.path(), &mut written);
    let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&artifacts), names(&written));
    for name in [
        "result.json",
        "measurements.json",
        "report.html",
        "contact.jpg",
        "tapes.jpg",
        "residuals.jpg",
        "body.ply",
        "body.glb",
        "views/000/mask.png",
    ] {
        assert!(artifacts.contains_key(name), "{name} is missing");
    }
    for (name, bytes) in &artifacts {
        assert_eq!(bytes, &written[name], "{name}");
    }
}
