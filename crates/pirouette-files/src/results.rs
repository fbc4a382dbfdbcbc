//! Result folders: masks, images, bodies, measurements and intermediate results.
//!
//! Keys are stable, lengths in mm or in px of the original photo, angles in degrees. In an existing folder, files are
//! replaced one by one; `result.json` lists them, so that the next job can remove those that it does not replace.

mod body_pose;
#[cfg(feature = "folders")]
mod earlier;
mod view_json;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pirouette_geom::Mask;
use pirouette_geom::parallel::prelude::*;
use pirouette_segment::border::sharpen_mask;
use serde_json::{Map, Value, json};
use thiserror::Error;

pub use body_pose::BodyPose;
#[cfg(feature = "folders")]
use earlier::EarlierResult;
#[cfg(feature = "folders")]
pub use earlier::remove_results;
use view_json::view_value;

use crate::formats::export::ExportFormat;
use crate::formats::mesh::{BodyMesh, MeshFormat};
use crate::formats::photo::{encode_jpeg, encode_mask, resample_mask, shrink};
use crate::report::json::measurements_json;
use crate::report::page::{Page, PageView, write_page};
use crate::report::pictures::{DrawnBody, draw_contact_sheet, draw_overlay, draw_residuals};
use crate::report::tape_sheet;
use crate::scan_folder::{LoadedScan, keypoint_file, keypoints_in_input};
#[cfg(feature = "folders")]
use crate::sink::make_folder;
use crate::sink::{Sink, WriteError};
use crate::warning::Warning;
use pirouette::pipeline::{Goal, Method, Report};
use pirouette::scan::{KeypointSource, Photo, Scan, View};
use pirouette::sizes::{Chart, advise_person};
use pirouette::skeleton_fit::{BoneScale, Skeleton, TurnFrom};
use pirouette::view::SolvedView;
use pirouette_body::{Camera, ReferencePose, TurnAngle};

/// Why results could not be written
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ResultError {
    /// Writing fails
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The encoder rejects an image
    #[error("cannot make {}: {source}", file.display())]
    Picture {
        /// The file
        file: PathBuf,
        /// Error of the encoder
        source: image::ImageError,
    },
    /// The encoder rejects a photo
    #[error("cannot make {}: {source}", file.display())]
    Jpeg {
        /// The file
        file: PathBuf,
        /// Error of the encoder
        source: jpeg_encoder::EncodingError,
    },
}

/// JPEG quality of the images, 1 to 100
const JPEG_QUALITY: u8 = 88;

/// Longer side of the overlays on the page, in px; a page of eight views then has about 2 MB
const PAGE_OVERLAY_PX: usize = 900;

/// Optional content of a result folder
#[derive(Debug, Clone, Copy, Default)]
pub struct ResultOptions<'a> {
    /// File formats of the body
    pub formats: &'a [MeshFormat],
    /// Pose of the body in these files; a carved body, which has no bones, stays in the reference pose
    pub body_pose: BodyPose,
    /// Title of `report.html`; `None` omits the page
    pub page_title: Option<&'a str>,
    /// Size charts; see [`pirouette::sizes`]
    pub charts: &'a [Chart],
    /// Formats of the measurements for other programs
    pub exports: &'a [ExportFormat],
}

/// Writes a report into a result folder
///
/// # Errors
/// When the folder cannot be written; files written until then remain, none is partial.
#[cfg(feature = "folders")]
pub fn write_results(
    folder: &Path,
    loaded: &LoadedScan,
    load_seconds: f64,
    report: &Report,
    options: &ResultOptions,
) -> Result<(), ResultError> {
    make_folder(folder)?;
    let earlier = EarlierResult::of(folder);
    // While files of both results exist, none may be taken for the measurements of this scan.
    earlier.remove_summary();
    let sink = Sink::folder(folder.to_owned());
    let written = write_artifacts(&sink, loaded, load_seconds, report, options);
    earlier.remove_except(&sink.names());
    written
}

/// Encodes the files that [`write_results`] writes, in memory: bytes by name, such as `views/000/mask.png`
///
/// # Errors
/// When an encoder rejects an image.
pub fn make_artifacts(
    loaded: &LoadedScan,
    load_seconds: f64,
    report: &Report,
    options: &ResultOptions,
) -> Result<BTreeMap<String, Vec<u8>>, ResultError> {
    let sink = Sink::memory();
    write_artifacts(&sink, loaded, load_seconds, report, options)?;
    Ok(sink.into_artifacts())
}

/// Writes a report into a sink, `result.json` last
fn write_artifacts(
    sink: &Sink,
    loaded: &LoadedScan,
    load_seconds: f64,
    report: &Report,
    options: &ResultOptions,
) -> Result<(), ResultError> {
    let with_page = options.page_title.is_some();
    let sheet = |name: &str, draw: &(dyn Fn() -> Option<Photo> + Sync)| {
        let Some(picture) = draw() else {
            return Ok(None);
        };
        let jpeg = as_jpeg(&sink.path(name), &picture)?;
        sink.put(name, &jpeg)?;
        Ok::<_, ResultError>(Some(jpeg))
    };
    let some_views = !report.views.is_empty();
    let write_views = || {
        let views = report.views.par_iter();
        let write = |view| write_view(sink, loaded, report, view, with_page);
        views.map(write).collect::<Result<Vec<_>, _>>()
    };
    let pictures = |body: Option<&DrawnBody>| {
        let contact = || some_views.then(|| draw_contact_sheet(loaded, report, body));
        let residuals = || {
            some_views
                .then(|| draw_residuals(loaded, report, body))
                .flatten()
        };
        let tapes = || {
            let (body, measurements) = (body?, report.measurements.as_ref()?);
            Some(tape_sheet(&body.surface, &body.mesh, measurements))
        };
        // The largest images are made one after the other, to limit the memory.
        let large = || {
            let contact = sheet("contact.jpg", &contact)?;
            Ok::<_, ResultError>((contact, sheet("residuals.jpg", &residuals)?))
        };
        // Views are many and small: they use the threads that the sheets leave idle.
        let small = || (sheet("tapes.jpg", &tapes), write_views());
        let (large, (tapes, page_overlays)) = pirouette_geom::parallel::join(large, small);
        let (contact, residuals) = large?;
        Ok::<_, ResultError>((contact, residuals, tapes?, page_overlays?))
    };
    let (body, written) = pirouette_geom::parallel::join(
        || DrawnBody::new(report),
        || write_bodies(sink, report, options),
    );
    written?;
    let (contact_sheet, residuals, tapes, page_overlays) = pictures(body.as_ref())?;
    let mut sizes = Vec::new();
    if let Some(measurements) = &report.measurements {
        let advice = advise_person(measurements, options.charts);
        let value = measurements_json(measurements, &advice);
        put_json(sink, "measurements.json", &value)?;
        for format in options.exports {
            sink.put(format.file_name(), format.write(measurements).into_bytes())?;
        }
        if measurements.in_mm() {
            let advice = advice.into_iter();
            sizes = advice.map(|a| (a.chart, a.verdict)).collect();
        }
    }
    if let Some(title) = options.page_title {
        let overlays = page_overlays.into_iter().flatten().collect();
        let page = Page {
            tapes,
            sizes,
            residuals,
            ..page(title, loaded, load_seconds, report, contact_sheet, overlays)
        };
        sink.put("report.html", write_page(&page).into_bytes())?;
    }
    // Last, so that an existing result.json means a complete result.
    let mut result = result_value(loaded, load_seconds, report);
    let own = ["result.json".to_owned()];
    result["files"] = sink.names().into_iter().chain(own).collect();
    put_json(sink, "result.json", &result)
}

/// Writes the body, and the hull if there is one, in each format
fn write_bodies(sink: &Sink, report: &Report, options: &ResultOptions) -> Result<(), ResultError> {
    // The lengths of a body that is not measured are wrong, too.
    if report.refusal.is_some() {
        return Ok(());
    }
    // A fitted body has bones and colors.
    let fitted = match (&report.fit, &report.dressed) {
        (_, Some(dressed)) => Some((&dressed.avatar, dressed.colors.as_ref())),
        (Some(fit), None) => Some((&fit.avatar, report.colors.as_ref())),
        (None, None) => None,
    };
    let posed = fitted.and_then(|(avatar, _)| options.body_pose.of(avatar, report));
    let body = report.body.as_ref().map(|mesh| match fitted {
        Some((avatar, colors)) => BodyMesh {
            colors: colors.map(|colors| &colors.srgb[..]),
            ..BodyMesh::from(posed.as_ref().unwrap_or(avatar))
        },
        None => BodyMesh::from(mesh),
    });
    let hull = report.hull.as_ref().map(BodyMesh::from);
    for (name, body) in [("body", body), ("hull", hull)] {
        if let Some(body) = body {
            for format in options.formats {
                let name = format!("{name}.{}", format.extension());
                sink.put(&name, format.write(body))?;
            }
        }
    }
    Ok(())
}

/// Writes the folder of one view and returns its overlay for the page
fn write_view(
    sink: &Sink,
    loaded: &LoadedScan,
    report: &Report,
    found: &SolvedView,
    with_page: bool,
) -> Result<Option<Vec<u8>>, ResultError> {
    let view = &loaded.scan.views[found.id.0];
    let within = |file: &str| format!("views/{}/{file}", view.name);
    let silhouette = &found.silhouette;
    let mask = in_input_size(view, &silhouette.mask, |width, height| {
        let mask = resample_mask(&silhouette.soft.to_grid(), width, height, 0.5);
        // Masks computed from a shrunk photo are refined along the edges of the original photo.
        let found_here = silhouette.seeds.is_some();
        let photo = found_here.then(|| loaded.full_size_photo(found.id.0));
        match photo.flatten() {
            Some(photo) => sharpen_mask(&photo, &mask),
            None => mask,
        }
    });
    put_mask(sink, &within("mask.png"), &mask)?;
    if let Some(normalized) = &found.normalized {
        let mask = in_input_size(view, &normalized.mask, |width, height| {
            resample_mask(&normalized.soft(), width, height, 0.5)
        });
        put_mask(sink, &within("normalized.png"), &mask)?;
    }
    let overlay = draw_overlay(view, report, found);
    let name = within("overlay.jpg");
    let file = sink.path(&name);
    sink.put(&name, as_jpeg(&file, &overlay)?)?;
    if view.keypoints_from != KeypointSource::Given {
        // Estimated joints were replaced by those of the fitted body.
        let skeleton = found.skeleton.as_ref();
        let keypoints = skeleton.map_or(&view.keypoints, |skeleton| &skeleton.keypoints);
        let value = keypoint_file(&keypoints_in_input(view, keypoints), view.keypoint_kind);
        put_json(sink, &within("keypoints.json"), &value)?;
    }
    let value = view_value(view, found);
    put_json(sink, &within("view.json"), &value)?;
    let for_page = with_page.then(|| as_jpeg(&file, &shrink(overlay, PAGE_OVERLAY_PX)));
    for_page.transpose()
}

fn page<'a>(
    title: &'a str,
    loaded: &'a LoadedScan,
    load_seconds: f64,
    report: &'a Report,
    contact_sheet: Option<Vec<u8>>,
    overlays: Vec<Vec<u8>>,
) -> Page<'a> {
    let scan = &loaded.scan;
    let given_count = loaded.scan.given_view_count();
    let mut facts = vec![
        ("views", format!("{} of {given_count}", report.views.len())),
        ("method", method_name(report.method).to_owned()),
        ("pose", pose_name(scan.pose).to_owned()),
    ];
    match count_from(scan, KeypointSource::BlazePose) {
        0 => {}
        count => facts.push(("keypoints", format!("detected in {count} photos"))),
    }
    match count_from(scan, KeypointSource::Estimate) {
        0 => {}
        count => facts.push(("keypoints", format!("estimated in {count} photos"))),
    }
    if let Some(stature_mm) = scan.stature_mm {
        facts.push(("stature as given", format!("{stature_mm:.0} mm")));
    }
    let failed = loaded.failed.iter();
    let failed = failed.map(ToString::to_string);
    let warnings = all_warnings(loaded, report).map(|warning| warning.to_string());
    let views = report.views.iter().zip(overlays);
    let seconds = report.seconds.iter();
    Page {
        title,
        facts,
        refusal: report.refusal.map(|refusal| refusal.to_string()),
        warnings: failed.chain(warnings).collect(),
        measurements: report
            .measurements
            .iter()
            .flat_map(|m| m.iter().map(|(measure, measured)| (measure, *measured)))
            .collect(),
        sizes: Vec::new(),
        tapes: None,
        contact_sheet,
        residuals: None,
        turn: loaded.video.as_ref().map_or(&[], |video| &video.turn),
        views: views
            .map(|(found, overlay)| PageView {
                name: &scan.views[found.id.0].name,
                time_s: scan.views[found.id.0].time_s,
                turn_degrees: found.turn_in_use(&scan.views[found.id.0]).degrees(),
                turn_sd_degrees: found
                    .skeleton
                    .map(|skeleton| skeleton.turn_sd_radians.to_degrees()),
                overlay,
            })
            .collect(),
        camera: report.skeleton.as_ref().map(|skeleton| &skeleton.camera),
        seconds: std::iter::once(("load", load_seconds))
            .chain(seconds.map(|(stage, time)| (stage.name(), *time)))
            .collect(),
    }
}

/// Returns the number of usable views with keypoints of an origin
fn count_from(scan: &Scan, source: KeypointSource) -> usize {
    let views = scan.views.iter();
    views.filter(|view| view.keypoints_from == source).count()
}

/// Returns the automatic corrections of loading and computation
fn all_warnings(loaded: &LoadedScan, report: &Report) -> impl Iterator<Item = Warning> {
    let of_scan = loaded.warnings.iter().cloned().map(Warning::Scan);
    of_scan.chain(report.warnings.iter().cloned().map(Warning::Job))
}

/// Returns a silhouette at the size of the original photo: the mask itself, or the level set of `scaled` if the sizes
/// differ
fn in_input_size<'a>(
    view: &View,
    mask: &'a Mask,
    scaled: impl FnOnce(usize, usize) -> Mask,
) -> Cow<'a, Mask> {
    let (width, height) = view.input_size_px;
    if (mask.width(), mask.height()) == (width, height) {
        Cow::Borrowed(mask)
    } else {
        Cow::Owned(scaled(width, height))
    }
}

fn put_mask(sink: &Sink, name: &str, mask: &Mask) -> Result<(), ResultError> {
    let png = encode_mask(mask).map_err(|source| ResultError::Picture {
        file: sink.path(name),
        source,
    })?;
    Ok(sink.put(name, png)?)
}

pub(crate) fn as_jpeg(file: &Path, picture: &Photo) -> Result<Vec<u8>, ResultError> {
    encode_jpeg(picture, JPEG_QUALITY).map_err(|source| ResultError::Jpeg {
        file: file.to_owned(),
        source,
    })
}

pub(crate) fn put_json(sink: &Sink, name: &str, value: &Value) -> Result<(), ResultError> {
    Ok(sink.put(name, format!("{value:#}\n").into_bytes())?)
}

/// Returns the content of `result.json`
pub fn result_value(loaded: &LoadedScan, load_seconds: f64, report: &Report) -> Value {
    let scan = &loaded.scan;
    let mut views: Vec<Value> = scan
        .views
        .iter()
        .enumerate()
        .map(|(index, view)| {
            let dropped = report.dropped.iter().find(|d| d.id.0 == index);
            let failure = dropped.map(|d| (d.stage.name(), d.reason.to_string()));
            let stated = view.turn_is_stated().then_some(view.turn);
            let found = report.views.iter().find(|found| found.id.0 == index);
            let turn = found.map_or(stated, |found| Some(found.turn_in_use(view)));
            let mut entry = view_entry(&view.name, turn, failure);
            if let Some(time_s) = view.time_s {
                entry["time_s"] = rounded(time_s, 3);
            }
            if let Some(skeleton) = found.and_then(|found| found.skeleton) {
                entry["angle_sd_deg"] = rounded(skeleton.turn_sd_radians.to_degrees(), 2);
                if skeleton.turn_from != TurnFrom::Stated {
                    let stated = stated.map(|turn| rounded(turn.degrees(), 3));
                    entry["stated_angle_deg"] = json!(stated);
                }
            }
            entry
        })
        .collect();
    views.extend(loaded.failed.iter().map(|failed| {
        let failure = Some(("load", failed.reason.to_string()));
        view_entry(&failed.view, failed.turn, failure)
    }));
    let warnings: Vec<Value> = all_warnings(loaded, report)
        .map(|warning| {
            let mut entry = json!({ "code": warning.code(), "message": warning.to_string() });
            if let Some(view) = warning.view() {
                entry["view"] = json!(view);
            }
            entry
        })
        .collect();
    let mut seconds = Map::from_iter([("load".to_owned(), rounded(load_seconds, 3))]);
    for (stage, time) in &report.seconds {
        seconds.insert(stage.name().to_owned(), rounded(*time, 3));
    }
    let mut value = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "goal": goal_name(report.goal),
        "method": method_name(report.method),
        "pose": pose_name(scan.pose),
        "stature_mm": scan.stature_mm,
        "views": views,
        "warnings": warnings,
        "seconds": seconds,
    });
    if let Some(refusal) = &report.refusal {
        value["refusal"] = json!({ "code": refusal.code(), "message": refusal.to_string() });
    }
    if count_from(scan, KeypointSource::BlazePose) > 0 {
        value["detector"] = json!("blazepose");
    } else if count_from(scan, KeypointSource::Estimate) > 0 {
        value["detector"] = json!("estimate");
    }
    if let Some(skeleton) = &report.skeleton {
        value["camera"] = camera_value(&skeleton.camera);
        value["skeleton"] = skeleton_value(skeleton, &loaded.scan.views);
    }
    if let Some(fit) = &report.fit {
        value["fit"] = json!({
            "residual_px": rounded(fit.residual_px, 3),
            "silhouette_iou": report.mean_fit_iou().map(|iou| rounded(iou, 4)),
        });
        if let Some(start) = &report.start {
            value["fit"]["start"] = json!({
                "sex": start.sex.name(), "mass_kg": rounded(start.mass_kg, 1),
            });
        }
    }
    value
}

fn view_entry(name: &str, turn: Option<TurnAngle>, failure: Option<(&str, String)>) -> Value {
    let angle = turn.map(|turn| rounded(turn.degrees(), 3));
    match failure {
        None => json!({ "name": name, "angle_deg": angle, "status": "ok" }),
        Some((stage, reason)) => json!({
            "name": name, "angle_deg": angle, "status": "failed", "stage": stage, "reason": reason,
        }),
    }
}

/// Returns the name of a method on the command line and in files
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Fit => "fit",
        Method::ThreeStep => "three-step",
    }
}

fn pose_name(pose: ReferencePose) -> &'static str {
    match pose {
        ReferencePose::A => "a",
        ReferencePose::T => "t",
    }
}

/// Returns the name of a goal on the command line and in files
pub fn goal_name(goal: Goal) -> &'static str {
    match goal {
        Goal::Segment => "segment",
        Goal::Normalize => "normalize",
        Goal::Reconstruct => "reconstruct",
        Goal::Measure => "measure",
    }
}

fn camera_value(camera: &Camera) -> Value {
    json!({
        "vertical_fov_deg": rounded(camera.vertical_fov_radians.to_degrees(), 3),
        "height_mm": rounded(camera.height_mm, 1),
        "distance_mm": rounded(camera.distance_mm, 1),
        "pitch_deg": rounded(camera.pitch_radians.to_degrees(), 3),
        "yaw_deg": rounded(camera.yaw_radians.to_degrees(), 3),
        "distortion": rounded(camera.distortion, 4),
    })
}

fn skeleton_value(skeleton: &Skeleton, views: &[View]) -> Value {
    let scales = BoneScale::ALL
        .iter()
        .map(|&scale| {
            let factor = skeleton.scales.factor(scale);
            (scale.name().to_owned(), rounded(factor, 4))
        })
        .collect::<Map<_, _>>();
    let fixed = skeleton
        .swaps
        .iter()
        .map(|(view, limb)| json!({ "view": views[*view].name, "swapped_back": limb.name() }));
    let outliers = skeleton.outliers.iter().map(|outlier| {
        json!({
            "view": views[outlier.view].name,
            "joint": outlier.joint.name(),
            "off_px": rounded(outlier.residual_px, 1),
        })
    });
    json!({
        "rms_px": rounded(skeleton.rms_px, 2),
        "bone_scales": scales,
        "turns": {
            "reversed": skeleton.turn_correction.reversed,
            "offset_deg": rounded(skeleton.turn_correction.offset.degrees(), 2),
        },
        "mended": fixed.collect::<Vec<_>>(),
        "outliers": outliers.collect::<Vec<_>>(),
    })
}

/// Rounds a number to `digits` decimal places; values that are not finite become null
fn rounded(value: f64, digits: i32) -> Value {
    let unit = 10f64.powi(digits);
    json!((value * unit).round() / unit)
}
