//! Complete jobs on a rendered scan of 8 views of 800 x 1000: from memory, and from a folder to a folder.

#![allow(missing_docs, reason = "criterion's macros generate public items")]

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, Report, run};
use pirouette::scan::Scan;
use pirouette_bench::{PHOTO_SIZE_PX, VIEW_COUNT, photograph};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::results::{ResultOptions, write_results};
use pirouette_files::scan_folder::{LoadOptions, load_scan, write_scan};

fn job(scan: &Scan, method: Method) -> Report {
    let config = Config::new(Goal::Measure, method);
    run(scan, &config, &CancelToken::default(), &mut |_| {})
        .expect("the rendered person is scanned")
}

fn complete_jobs(c: &mut Criterion) {
    let scan = photograph(PHOTO_SIZE_PX.0, PHOTO_SIZE_PX.1, VIEW_COUNT).scan;
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_scan(folder.path(), &scan).expect("photos can be written");
    let load =
        || load_scan(folder.path(), &LoadOptions::default()).expect("they were just written");
    c.bench_function("load the folder", |b| b.iter(load));
    for (name, method) in [("fit", Method::Fit), ("three-step", Method::ThreeStep)] {
        c.bench_function(&format!("scan from memory, {name}"), |b| {
            b.iter(|| job(&scan, method));
        });
    }
    let results = folder.path().join("results");
    c.bench_function("scan from folder to folder, fit", |b| {
        b.iter(|| {
            let loaded = load();
            let report = job(&loaded.scan, Method::Fit);
            let options = ResultOptions {
                formats: &[MeshFormat::Ply],
                page_title: None,
                charts: &built_in_charts(),
                exports: &[],
                ..ResultOptions::default()
            };
            write_results(&results, &loaded, 0.0, &report, &options)
                .expect("results can be written");
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(5));
    targets = complete_jobs
}
criterion_main!(benches);
