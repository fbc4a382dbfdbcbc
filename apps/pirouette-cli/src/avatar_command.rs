//! `pirouette avatar`: writes the reference avatar as an image or a mesh.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, Pose, ReferencePose, TurnAngle, gltf, render};
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::formats::photo::{encode_mask, encode_photo_png};
use pirouette_files::sink::write_atomic;
use pirouette_geom::Mask;
use pirouette_synthetic::SyntheticOptions;
use serde_json::json;

use crate::args::{self, AvatarArgs};
use crate::output::Output;

/// Columns and rows of images
const PICTURE_SIZE_PX: (usize, usize) = (800, 1000);

/// Builds or reads the avatar and writes it in the format given by the file extension
pub fn run(args: &AvatarArgs, output: Output) -> Result<()> {
    ensure!(args.angle.is_finite(), "--angle is not finite");
    let kind = Kind::of(&args.out)?;
    let avatar = avatar(args)?;
    let bytes = match kind {
        Kind::Picture => picture(&avatar, TurnAngle::from_degrees(args.angle), args.shaded)?,
        Kind::Mesh(format) => format.write(&avatar),
    };
    write_atomic(&args.out, &bytes)?;
    let (stature_mm, vertices) = (avatar.stature_mm(), avatar.mesh.positions.len());
    output.done(
        &format!(
            "{}: {stature_mm:.0} mm tall, {vertices} vertices",
            args.out.display()
        ),
        || json!({ "ok": true, "out": args.out, "stature_mm": stature_mm, "vertices": vertices }),
    )
}

/// Output format, by file extension
enum Kind {
    Picture,
    Mesh(MeshFormat),
}

impl Kind {
    fn of(file: &Path) -> Result<Self> {
        let ending = file.extension().unwrap_or_default().to_string_lossy();
        if ending.eq_ignore_ascii_case("png") {
            return Ok(Kind::Picture);
        }
        match MeshFormat::from_extension(&ending) {
            Some(format) => Ok(Kind::Mesh(format)),
            None => bail!(
                "{}: unknown file extension; use .png for an image, or .glb, .ply, .obj, .stl or .off for a mesh",
                file.display()
            ),
        }
    }
}

fn avatar(args: &AvatarArgs) -> Result<Avatar> {
    let pose = match args.pose {
        args::Pose::A => ReferencePose::A,
        args::Pose::T => ReferencePose::T,
    };
    let Some(file) = &args.avatar else {
        return Ok(mannequin(&MannequinParameters {
            sex: mannequin_sex(args.sex),
            stature_mm: args.stature,
            mass_kg: args.mass,
            pose,
            ..MannequinParameters::default()
        })?);
    };
    let bytes = std::fs::read(file)
        .with_context(|| format!("cannot read the avatar {}", file.display()))?;
    let avatar = gltf::load_avatar(&bytes, pose).with_context(|| file.display().to_string())?;
    Ok(match args.stature {
        Some(stature_mm) => {
            ensure!(
                (100.0..=10_000.0).contains(&stature_mm),
                "--stature is {stature_mm} mm; it must be between 100 and 10000"
            );
            avatar.scaled_to(stature_mm)
        }
        None => avatar,
    })
}

/// Renders the avatar from a camera at about half its height, as a PNG file
fn picture(avatar: &Avatar, turn: TurnAngle, shaded: bool) -> Result<Vec<u8>> {
    let (width, height) = PICTURE_SIZE_PX;
    let camera = SyntheticOptions::camera_for(avatar.stature_mm(), width, height);
    let positions = avatar.posed(&Pose::default(), turn).positions;
    let mesh = render::SilhouetteMesh::new(&avatar.mesh.triangles);
    Ok(if shaded {
        encode_photo_png(&render::shade(&mesh, &positions, None, &camera))?
    } else {
        let mask: Mask = mesh.silhouette(&positions, &camera).threshold(0.5);
        encode_mask(&mask)?
    })
}

/// Returns the corresponding value of the library; neutral for `None`
pub fn mannequin_sex(sex: Option<args::Sex>) -> pirouette_body::Sex {
    match sex {
        Some(args::Sex::Female) => pirouette_body::Sex::Female,
        Some(args::Sex::Male) => pirouette_body::Sex::Male,
        None => pirouette_body::Sex::Neutral,
    }
}
