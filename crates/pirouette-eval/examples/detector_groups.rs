//! Evaluates the pose detector on rendered people by group: light, tone of the skin, sex, body mass, side of the person.
//!
//! ```text
//! cargo run --release -p pirouette-eval --example detector_groups -- pose_landmark_full.tflite 40
//! ```
//!
//! Eight photos per person, in a furnished room. Prints a Markdown table: photos without a detection; mean distance of the
//! detected joints from where the detector is expected to place them ([`pirouette::detect`]), in percent of the stature;
//! photos with the arms or the legs swapped, i.e. whose joints fit better with left and right exchanged.

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;

use glam::DVec2;
use pirouette::detect::{detect_keypoints, detected_positions};
use pirouette_body::{Joint, Keypoints, PerJoint};
use pirouette_eval::people::Person;
use pirouette_pose::PoseModel;
use pirouette_synthetic::{Appearance, Lighting};

/// Seed of the first person; other studies use smaller ones
const FIRST_SEED: u64 = 7000;

/// Photos per person
const VIEW_COUNT: usize = 8;

/// Number of tones of the skin
const TONE_COUNT: usize = 6;

const ARM: [Joint; 3] = [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist];
const LEG: [Joint; 3] = [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle];

/// The result of one photo
struct Seen {
    groups: Vec<String>,
    found: Option<Found>,
}

struct Found {
    /// Distance of each found joint, in percent of the stature
    errors: Vec<f64>,
    arms_swapped: bool,
    legs_swapped: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, count] = &arguments[..] else {
        return Err("usage: detector_groups MODEL NUMBER_OF_PEOPLE".into());
    };
    let model = PoseModel::parse(&std::fs::read(file)?)?;
    let mut all = Vec::new();
    for index in 0..count.parse()? {
        all.extend(photos_of(&model, index)?);
    }
    println!(
        "| group | photos | without a person | joint error, % | 95th percentile, % | arms swapped | legs swapped |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut groups: Vec<&String> = all.iter().flat_map(|seen| &seen.groups).collect();
    groups.sort();
    groups.dedup();
    for group in groups {
        let of_group: Vec<&Seen> = all.iter().filter(|s| s.groups.contains(group)).collect();
        println!("{}", row(group, &of_group));
    }
    Ok(())
}

/// Photographs one person and runs the detector
fn photos_of(model: &PoseModel, index: usize) -> Result<Vec<Seen>, Box<dyn Error>> {
    let person = Person::new(FIRST_SEED + index as u64)?;
    // Pairs of a woman and a man; each light meets each tone of the skin.
    let pair = index / 2;
    let lighting = Lighting::ALL[pair % Lighting::ALL.len()];
    let tone = (pair + pair / Lighting::ALL.len()) % TONE_COUNT;
    let appearance = Appearance {
        skin_tone: Some(tone as f64 / (TONE_COUNT - 1) as f64),
        lighting,
    };
    let synthetic = person.photograph_in(VIEW_COUNT, &appearance);
    let views = &synthetic.scan.views;
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    let found = detect_keypoints(model, &photos, None, false, &|| {}, &|| false).keypoints;
    let (avatar, camera) = (&person.avatar, &synthetic.truth.camera);
    let expected = detected_positions(avatar);
    let px_per_percent = camera.focal_px() / camera.distance_mm * avatar.stature_mm() / 100.0;
    let mass = match person.bmi {
        ..22.0 => "body: BMI 17 to 22",
        22.0..30.0 => "body: BMI 22 to 30",
        _ => "body: BMI 30 to 38",
    };
    let seen = views.iter().zip(&synthetic.truth.poses).zip(found);
    let seen = seen.map(|((view, pose), found)| {
        let joints = avatar.posed(pose, view.turn).bones.keypoints(&expected);
        let truth = joints.map(|p| camera.project(p));
        let side = match view.turn.degrees().rem_euclid(360.0) {
            60.0..120.0 | 240.0..300.0 => "view: from the side",
            120.0..240.0 => "view: from behind, up to 45 degrees",
            _ => "view: from the front, up to 45 degrees",
        };
        Seen {
            groups: vec![
                "all".to_owned(),
                format!("light: {}", lighting.name()),
                format!("skin: {} of {TONE_COUNT}, from dark to light", tone + 1),
                format!("sex: {}", person.sex.name()),
                mass.to_owned(),
                side.to_owned(),
            ],
            found: found.map(|keypoints| compare(&keypoints, &truth, px_per_percent)),
        }
    });
    Ok(seen.collect())
}

fn compare(keypoints: &Keypoints, truth: &PerJoint<DVec2>, px_per_percent: f64) -> Found {
    // Middles are defined by their sides.
    let found = Joint::ALL.iter().filter(|j| j.middle_of().is_none());
    let errors = found.filter_map(|&joint| {
        let keypoint = keypoints.found(joint)?;
        Some((keypoint.position - truth[joint]).length() / px_per_percent)
    });
    let swapped = |limb: [Joint; 3]| {
        let both = limb.iter().flat_map(|&left| [left, left.mirrored()]);
        let sums = both.fold([0.0; 2], |[same, other], joint| {
            let position = keypoints.get(joint).position;
            let distance = |to: Joint| (position - truth[to]).length();
            [same + distance(joint), other + distance(joint.mirrored())]
        });
        sums[1] < sums[0]
    };
    Found {
        errors: errors.collect(),
        arms_swapped: swapped(ARM),
        legs_swapped: swapped(LEG),
    }
}

fn row(group: &str, photos: &[&Seen]) -> String {
    let found: Vec<&Found> = photos.iter().filter_map(|s| s.found.as_ref()).collect();
    let mut errors: Vec<f64> = found.iter().flat_map(|f| f.errors.clone()).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let high = errors
        .get(errors.len() * 95 / 100)
        .copied()
        .unwrap_or(f64::NAN);
    let count = |is: fn(&Found) -> bool| found.iter().filter(|f| is(f)).count();
    format!(
        "| {group} | {} | {} | {mean:.2} | {high:.2} | {} | {} |",
        photos.len(),
        photos.len() - found.len(),
        count(|f| f.arms_swapped),
        count(|f| f.legs_swapped)
    )
}
