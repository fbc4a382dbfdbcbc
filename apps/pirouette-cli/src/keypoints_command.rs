//! `pirouette keypoints`: runs the pose detector alone.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Error, Result, bail};
use pirouette::pipeline::CancelToken;
use pirouette_files::job::JobError;
use pirouette_files::keypoint_files::{DetectedPhotos, detect_photos, open_photos};
use serde_json::{Value, json};

use crate::args::KeypointsArgs;
use crate::models_command::pose_model;
use crate::output::Output;
use crate::progress::Progress;

/// Detects keypoints in folders, zip files and photos, one after another, and writes them
pub fn run(args: &KeypointsArgs, output: Output, quiet: bool, cancel: &CancelToken) -> Result<()> {
    let Some(model) = pose_model(args.pose_model.as_deref())? else {
        bail!(
            "no pose detector is installed; run 'pirouette models install', or name a network with --pose-model FILE"
        );
    };
    let progress = Progress::new(quiet);
    let mut names = BTreeSet::new();
    let mut photos = Vec::new();
    for path in &args.photos {
        let source = open_photos(path)?;
        let found = detect_photos(source, &model, cancel, &mut |event| {
            progress.show_job(&event);
        });
        let found = found.map_err(|error| match error {
            JobError::Pipeline(error) => Error::new(error).context(path.display().to_string()),
            error => error.into(),
        })?;
        for view in found.views() {
            if !names.insert(view.name.clone()) {
                bail!(
                    "a second photo named {} in {}; use another folder with -o for it",
                    view.name,
                    path.display()
                );
            }
        }
        if !found.views().is_empty() {
            found.write(&args.out)?;
        }
        photos.extend(entries(&found, path));
    }
    progress.finish();
    if names.is_empty() {
        let paths: Vec<_> = args
            .photos
            .iter()
            .map(|p| p.display().to_string())
            .collect();
        bail!("no keypoints were detected in {}", paths.join(", "));
    }
    let text = format!(
        "{}: keypoints of {} of {} photos",
        args.out.display(),
        names.len(),
        photos.len()
    );
    output.done(
        &text,
        || json!({ "ok": true, "out": args.out, "photos": photos }),
    )
}

/// Returns the entries of the line of JSON, one per photo
fn entries(found: &DetectedPhotos, path: &Path) -> Vec<Value> {
    let detected = found.views().iter().map(|view| {
        let [keypoints, picture] = DetectedPhotos::file_names(view);
        json!({
            "name": view.name, "from": path, "status": "ok", "joint_count": view.keypoints.found_count(),
            "keypoints": keypoints, "picture": picture,
        })
    });
    let failed = found.failed().iter().map(|failed| {
        json!({
            "name": failed.view, "from": path, "status": "failed", "reason": failed.reason.to_string(),
        })
    });
    detected.chain(failed).collect()
}
