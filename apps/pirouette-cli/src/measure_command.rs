//! `pirouette measure`: the tapes of a mesh, or of photos as `scan`.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use pirouette::mesh_scan::MeshScanOptions;
use pirouette::pipeline::{CancelToken, Goal};
use pirouette::scan::Subject;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::run_mesh_job;

use crate::args::{MeasureArgs, Method};
use crate::avatar_command::mannequin_sex;
use crate::output::Output;
use crate::progress::Progress;
use crate::scan_command;

/// Measures a mesh or a scan
pub fn run(args: &MeasureArgs, output: Output, quiet: bool, cancel: &CancelToken) -> Result<()> {
    let file = &args.scan.scan;
    let of_mesh_only = args.unit.is_some() || args.up.is_some() || args.front.is_some();
    let Some(format) = mesh_format(file) else {
        ensure!(
            !of_mesh_only && args.sex.is_none(),
            "{}: --unit, --up, --front and --sex are for meshes; a scan has its data in scan.json",
            file.display()
        );
        return scan_command::run(&args.scan, Goal::Measure, output, quiet, cancel);
    };
    measure_mesh(args, format, output, quiet, cancel)
}

/// Returns the format of a mesh file; `None` for scans
fn mesh_format(file: &Path) -> Option<MeshFormat> {
    let extension = file.extension()?.to_str()?;
    MeshFormat::from_extension(extension).filter(|_| !file.is_dir())
}

fn measure_mesh(
    args: &MeasureArgs,
    format: MeshFormat,
    output: Output,
    quiet: bool,
    cancel: &CancelToken,
) -> Result<()> {
    let scan = &args.scan;
    ensure!(
        scan.method.method == Method::Fit,
        "--method three-step is for photos: a mesh is measured by the method fit"
    );
    ensure!(
        scan.keypoints.is_none() && scan.angles.is_none() && scan.scale.is_none(),
        "--keypoints, --angles and --scale are for photos, not for meshes"
    );
    let progress = Progress::new(quiet);
    let config = scan_command::config(&scan.method, Goal::Measure)?;
    let name = scan.scan.display().to_string();
    let title = scan.scan.file_stem().unwrap_or_default();
    let title = title.to_string_lossy();
    let options = MeshScanOptions {
        unit: args.unit.map(|unit| unit.of_mesh()),
        up: args.up.map(|axis| axis.of_mesh()),
        front: args.front.map(|axis| axis.of_mesh()),
        subject: Subject {
            sex: args.sex.map(|sex| mannequin_sex(Some(sex))),
            ..Subject::default()
        },
    };
    let job = || {
        let bytes = std::fs::read(&scan.scan).with_context(|| format!("cannot read {name}"))?;
        let mesh = format.read(&bytes).with_context(|| name.clone())?;
        let done = run_mesh_job(&mesh, &options, &config, cancel, &mut |event| {
            progress.show_job(&event);
        });
        done.with_context(|| name.clone())
    };
    scan_command::write_and_print(scan, &title, output, &progress, job)
}
