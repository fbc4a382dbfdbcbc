//! Measures how turn angles of a track depend on the pose detector, on rendered people.
//!
//! ```text
//! cargo run --release -p pirouette-eval --example detector_turns -- pose_landmark_full.tflite 12 [AVATAR.glb ...]
//! ```
//!
//! Each person is photographed in 48 directions, and [`TurnTrack`] finds the angles as in a video of one turn in 12 s.
//! Prints the mean error of each sector over the people and its standard deviation, and that of the odd harmonics: those
//! that are equal in the mirror. The people are random ones, or given avatars at their statures.

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;

use pirouette::detect::detect_keypoints;
use pirouette::video::TurnTrack;
use pirouette_body::gltf::load_avatar;
use pirouette_body::{Avatar, ReferencePose};
use pirouette_eval::people::Person;
use pirouette_pose::PoseModel;

/// Directions of one turn
const VIEWS: usize = 48;
/// Duration of the turn, in s
const TURN_S: f64 = 12.0;
/// Harmonics of the odd part
const HARMONICS: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, count, avatars @ ..] = &arguments[..] else {
        return Err("usage: detector_turns MODEL NUMBER_OF_PEOPLE [AVATAR.glb ...]".into());
    };
    let model = PoseModel::parse(&std::fs::read(file)?)?;
    let avatars: Vec<Avatar> = avatars
        .iter()
        .map(|file| Ok(load_avatar(&std::fs::read(file)?, ReferencePose::A)?))
        .collect::<Result<_, Box<dyn Error>>>()?;
    let mut all: Vec<Vec<f64>> = Vec::new();
    for seed in 0..count.parse()? {
        let mut person = Person::new(1000 + seed)?;
        if !avatars.is_empty() {
            let avatar = &avatars[seed as usize % avatars.len()];
            person.avatar = avatar.clone().scaled_to(person.avatar.stature_mm());
        }
        let errors = errors(&model, &person)?;
        let harmonics: Vec<String> = harmonics(&errors)
            .iter()
            .map(|h| format!("{h:6.1}"))
            .collect();
        println!("{}: {}", person.describe(), harmonics.join(" "));
        all.push(errors);
    }
    println!("angle    mean      sd");
    for view in 0..VIEWS {
        let of_view: Vec<f64> = all.iter().map(|errors| errors[view]).collect();
        let (mean, sd) = mean_and_sd(&of_view);
        println!(
            "{:6.1}{mean:8.1}{sd:8.1}",
            360.0 * view as f64 / VIEWS as f64
        );
    }
    for k in 0..HARMONICS {
        let (mean, sd) = mean_and_sd(&all.iter().map(|e| harmonics(e)[k]).collect::<Vec<_>>());
        println!("sin {} angle: {mean:.1} ± {sd:.1}", k + 1);
    }
    Ok(())
}

/// Returns the error of the track in each direction, in degrees, without their mean
fn errors(model: &PoseModel, person: &Person) -> Result<Vec<f64>, Box<dyn Error>> {
    let synthetic = person.photograph(VIEWS, 0.0, true);
    let photos: Vec<_> = synthetic
        .scan
        .views
        .iter()
        .map(|view| &view.photo)
        .collect();
    let found = detect_keypoints(model, &photos, None, false, &|| {}, &|| false).keypoints;
    let time_s = |view: usize| TURN_S * view as f64 / VIEWS as f64;
    // The turn before and the one after, so that all directions have neighbors
    let frames = (0..3 * VIEWS).map(|i| (time_s(i), found[i % VIEWS].as_ref()));
    let track = TurnTrack::find(frames)?;
    let errors: Option<Vec<f64>> = (0..VIEWS)
        .map(|view| {
            let found = track.angle_at(time_s(VIEWS + view))?.to_degrees();
            let error = found - synthetic.scan.views[view].turn.degrees();
            Some((error + 180.0).rem_euclid(360.0) - 180.0)
        })
        .collect();
    let mut errors = errors.ok_or("the track is shorter than the turns")?;
    let (mean, _) = mean_and_sd(&errors);
    errors.iter_mut().for_each(|error| *error -= mean);
    Ok(errors)
}

fn harmonics(errors: &[f64]) -> [f64; HARMONICS] {
    std::array::from_fn(|k| {
        let products = errors.iter().enumerate().map(|(view, error)| {
            let angle = std::f64::consts::TAU * view as f64 / VIEWS as f64;
            error * ((k + 1) as f64 * angle).sin()
        });
        2.0 / VIEWS as f64 * products.sum::<f64>()
    })
}

fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / count).sqrt())
}
