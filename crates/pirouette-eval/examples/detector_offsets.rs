//! Estimates where the pose detector places each joint relative to the skeleton, on rendered people.
//!
//! ```text
//! cargo run --release -p pirouette-eval --example detector_offsets -- pose_landmark_full.tflite 24 a [AVATAR.glb ...]
//! ```
//!
//! For each pair of left and right joints, the offset that explains the detected positions in all photos is solved by
//! robust least squares, in the frame of the bone in the reference pose: outward from the middle of the body, up,
//! forward. Prints offsets and remaining errors in permille of the stature. The people are random ones, or given avatars at
//! their statures. The offsets of [`pirouette::detect`] are those of 24 people each in A- and T-pose, of the neutral and
//! the male MakeHuman base mesh (CC0).

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;

use glam::{DMat3, DVec2, DVec3};
use pirouette::detect::detect_keypoints;
use pirouette_body::gltf::load_avatar;
use pirouette_body::{Avatar, Joint, PerJoint, Pose, ReferencePose};
use pirouette_eval::people::Person;
use pirouette_pose::PoseModel;

/// Residuals beyond this lose weight, in permille of the stature
const ROBUST: f64 = 15.0;

/// One detected coordinate: its derivative by the offset, and its difference to the skeleton, in permille
struct Row {
    gradient: DVec3,
    difference: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, count, pose, avatars @ ..] = &arguments[..] else {
        return Err("usage: detector_offsets MODEL NUMBER_OF_PEOPLE a|t [AVATAR.glb ...]".into());
    };
    let pose = match &pose[..] {
        "a" => ReferencePose::A,
        "t" => ReferencePose::T,
        other => return Err(format!("the pose is {other}; a or t is read").into()),
    };
    let model = PoseModel::parse(&std::fs::read(file)?)?;
    let avatars: Vec<Avatar> = avatars
        .iter()
        .map(|file| Ok(load_avatar(&std::fs::read(file)?, pose)?))
        .collect::<Result<_, Box<dyn Error>>>()?;
    let mut rows: PerJoint<Vec<Row>> = PerJoint::from_fn(|_| Vec::new());
    let mut missed = 0;
    for seed in 0..count.parse()? {
        let mut person = Person::new(1000 + seed)?;
        if !avatars.is_empty() {
            let avatar = &avatars[seed as usize % avatars.len()];
            person.avatar = avatar.clone().scaled_to(person.avatar.stature_mm());
        }
        missed += collect(&model, &person, &mut rows);
    }
    println!(
        "{:<16}{:>8}{:>8}{:>8}   remaining",
        "joint", "outward", "up", "forward"
    );
    for joint in Joint::ALL {
        let mirrored = joint.mirrored();
        if mirrored < joint || rows[joint].is_empty() {
            continue;
        }
        let mut all: Vec<&Row> = rows[joint].iter().collect();
        if mirrored != joint {
            all.extend(&rows[mirrored]);
        }
        let (offset, remaining) = solve(&all);
        println!(
            "{:<16}{:8.1}{:8.1}{:8.1}   {remaining:.1}",
            joint.name(),
            offset.x,
            offset.y,
            offset.z
        );
    }
    println!("photos without a person: {missed}");
    Ok(())
}

/// Adds the differences of one person's photos; returns the number of photos without a detection
fn collect(model: &PoseModel, person: &Person, rows: &mut PerJoint<Vec<Row>>) -> usize {
    let synthetic = person.photograph(8, 0.0, true);
    let photos: Vec<_> = synthetic
        .scan
        .views
        .iter()
        .map(|view| &view.photo)
        .collect();
    let found = detect_keypoints(model, &photos, None, false, &|| {}, &|| false).keypoints;
    let (avatar, camera) = (&person.avatar, &synthetic.truth.camera);
    let unit = avatar.stature_mm() / 1000.0;
    let px_per_permille = camera.focal_px() / camera.distance_mm * unit;
    let mut missed = 0;
    let views = synthetic.scan.views.iter().zip(&synthetic.truth.poses);
    for ((view, pose), found) in views.zip(found) {
        let Some(found) = found else {
            missed += 1;
            continue;
        };
        let pose: &Pose = pose;
        let bones = avatar.posed(pose, view.turn).bones;
        let joints = bones.keypoints(&avatar.keypoints);
        for (joint, keypoint) in found.iter().filter(|(_, k)| k.confidence > 0.0) {
            // Middles are defined by their sides.
            if joint.middle_of().is_some() {
                continue;
            }
            let difference: DVec2 = keypoint.position - camera.project(joints[joint]);
            let out = if joint.name().starts_with("left") {
                1.0
            } else {
                -1.0
            };
            let side = DMat3::from_diagonal(DVec3::new(out, 1.0, 1.0));
            let rotation = bones.transforms[joint.bone()].matrix3 * side;
            let gradients = camera.project_gradients(joints[joint]);
            for (gradient, difference) in gradients.into_iter().zip(difference.to_array()) {
                rows[joint].push(Row {
                    gradient: rotation.transpose() * gradient * unit / px_per_permille,
                    difference: difference / px_per_permille,
                });
            }
        }
    }
    missed
}

/// Returns the offset in permille of the stature, and the root mean square of the remaining differences per coordinate
fn solve(rows: &[&Row]) -> (DVec3, f64) {
    let mut offset = DVec3::ZERO;
    let mut remaining = 0.0;
    for _ in 0..20 {
        let (mut matrix, mut right) = (DMat3::IDENTITY * 1e-9, DVec3::ZERO);
        let (mut sum, mut weights) = (0.0, 0.0);
        for row in rows {
            let residual = row.difference - row.gradient.dot(offset);
            let weight = 1.0 / (1.0 + (residual / ROBUST).powi(2));
            let g = row.gradient;
            matrix += DMat3::from_cols(g * g.x, g * g.y, g * g.z) * weight;
            right += g * (weight * row.difference);
            sum += weight * residual * residual;
            weights += weight;
        }
        offset = matrix.inverse() * right;
        remaining = (sum / weights).sqrt();
    }
    (offset, remaining)
}
