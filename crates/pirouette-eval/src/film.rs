//! Videos of rendered people, as files.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use pirouette::pipeline::CancelToken;
use pirouette_body::Avatar;
use pirouette_files::sink::{WriteError, make_folder, write_atomic};
use pirouette_files::video::{VideoError, VideoWriter};
use pirouette_synthetic::video::{VideoOptions, render_video};
use serde_json::{Value, json};
use thiserror::Error;

/// Bits per second of the videos
pub const BITS_PER_S: u32 = 4_000_000;

/// Name of the file with the true angles, in the folder of the video
const TRUTH_FILE: &str = "truth/angles.json";

/// Why there is no video
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum FilmError {
    #[error(transparent)]
    Video(#[from] VideoError),
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error("cancelled")]
    Cancelled,
}

/// Films a rendered person: writes `person.mp4`, `scan.json`, and the true angles as `truth/angles.json` to a folder
///
/// Returns the true angle of each frame, in radians. `on_share` gets the share that is done, from 0 to 1.
///
/// # Errors
/// When a file cannot be written, `ffmpeg` is missing, or the work is cancelled.
pub fn film(
    person: &Avatar,
    options: &VideoOptions,
    folder: &Path,
    cancel: &CancelToken,
    on_share: &mut dyn FnMut(f64),
) -> Result<Vec<f64>, FilmError> {
    make_folder(&folder.join("truth"))?;
    let camera = options.camera;
    let manifest = json!({
        "subject": { "stature_mm": person.stature_mm() },
        "camera": {
            "vertical_fov_deg": camera.vertical_fov_radians.to_degrees(),
            "height_mm": camera.height_mm,
        },
    });
    write_atomic(
        &folder.join("scan.json"),
        format!("{manifest:#}\n").as_bytes(),
    )?;
    let frame_count = options.turn.duration_s() * options.frames_per_s;
    let size_px = (camera.width_px, camera.height_px);
    let file = folder.join("person.mp4");
    let mut writer = VideoWriter::create(&file, size_px, options.frames_per_s, BITS_PER_S)?;
    let mut written = Ok(());
    let angles = render_video(person, options, &mut |index, photo| {
        on_share(index as f64 / frame_count);
        written = writer.write(&photo);
        if written.is_err() || cancel.cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    written?;
    if cancel.cancelled() {
        return Err(FilmError::Cancelled);
    }
    writer.finish()?;
    let degrees: Vec<f64> = angles.iter().map(|angle| angle.to_degrees()).collect();
    let truth = json!({ "frames_per_s": options.frames_per_s, "angles_deg": degrees });
    write_atomic(&folder.join(TRUTH_FILE), truth.to_string().as_bytes())?;
    Ok(angles)
}

/// Returns the true angles of a video that was filmed before, in radians; `None` if its files are incomplete
pub fn filmed(folder: &Path) -> Option<Vec<f64>> {
    let complete = ["person.mp4", "scan.json"]
        .iter()
        .all(|name| folder.join(name).is_file());
    let truth: Value = serde_json::from_slice(&fs::read(folder.join(TRUTH_FILE)).ok()?).ok()?;
    let angles = truth["angles_deg"].as_array()?.iter();
    let angles: Option<Vec<f64>> = angles.map(|v| Some(v.as_f64()?.to_radians())).collect();
    angles.filter(|_| complete)
}
