//! `pirouette arap`: as-rigid-as-possible deformation of a planar mesh.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use pirouette_files::formats::mesh::{
    MeshFormat, read_off, write_obj, write_off, write_ply, write_stl,
};
use pirouette_files::formats::points::parse_points;
use pirouette_files::sink::write_atomic;
use pirouette_geom::TriMesh;
use pirouette_geom::arap::{ArapOptions, deform_points};
use serde_json::json;

use crate::args::ArapArgs;
use crate::output::Output;

/// Deforms a planar mesh and writes the result
pub fn run(args: &ArapArgs, output: Output) -> Result<()> {
    let write = writer(&args.out)?;
    let mesh = read(&args.mesh)?;
    let mesh = read_off(&mesh).with_context(|| args.mesh.display().to_string())?;
    let points = |file: &Path| {
        let bytes = read(file)?;
        parse_points(&bytes).with_context(|| file.display().to_string())
    };
    let (source, target) = (points(&args.source)?, points(&args.target)?);
    ensure!(
        source.len() == target.len(),
        "{} has {} points, but {} has {}; both files need one row per point",
        args.source.display(),
        source.len(),
        args.target.display(),
        target.len()
    );
    let deformed = deform_points(&mesh, &source, &target, &ArapOptions::precise())
        .with_context(|| format!("cannot deform {}", args.mesh.display()))?;
    write_atomic(&args.out, &write(&deformed))?;
    output.done(
        &format!(
            "{}: {} vertices, {} moved to targets",
            args.out.display(),
            deformed.positions.len(),
            source.len()
        ),
        || json!({ "ok": true, "out": args.out, "vertices": deformed.positions.len() }),
    )
}

/// Returns the function that writes the format of a file name; without an extension, OFF
fn writer(out: &Path) -> Result<fn(&TriMesh) -> Vec<u8>> {
    let Some(extension) = out.extension() else {
        return Ok(write_off);
    };
    match MeshFormat::from_extension(&extension.to_string_lossy()) {
        Some(MeshFormat::Off) => Ok(write_off),
        Some(MeshFormat::Obj) => Ok(write_obj),
        Some(MeshFormat::Ply) => Ok(|mesh| write_ply(mesh, None)),
        Some(MeshFormat::Stl) => Ok(write_stl),
        // GLB has units, a planar mesh has none.
        Some(MeshFormat::Glb) | None => bail!(
            "cannot write {}: a planar mesh can be written as .off, .obj, .ply or .stl",
            out.display()
        ),
    }
}

fn read(file: &Path) -> Result<Vec<u8>> {
    std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))
}
