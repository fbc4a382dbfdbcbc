//! Scores of result folders and of single photos against ground truth in a folder.
//!
//! A folder with ground truth contains, next to the photos, `truth/<stem>_mask.png` (the person in the photo), and
//! optionally `truth/<stem>_canonical.png` (the person in the reference pose without sway, at the same turn angle),
//! `truth/body.ply` (the body in the reference pose, mm) and `truth/truth.json` (`measurements_mm`). Scores with
//! missing input are omitted.

use std::path::{Path, PathBuf};
use std::{fs, io};

use pirouette::pipeline::{CancelToken, Config, Goal, Method, PipelineError, run};
use pirouette::scan::Scan;
use pirouette_files::formats::mesh::{ReadMeshError, read_obj, read_off, read_ply};
use pirouette_files::formats::photo::{PhotoError, decode_mask, resample};
use pirouette_files::scan_folder::{LoadOptions, ScanError, load_scan};
use pirouette_geom::{Mask, TriMesh};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use thiserror::Error;

use crate::score::girth::trunk_girth;
use crate::score::masks::{best_shift_iou, halved};
use crate::score::surface::surface_error;
use crate::table::{Cell, Table, mean, percentile};
use crate::{OnStep, StudyError, do_all};

/// Why a folder has no score
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum ScoreError {
    #[error(
        "{} has no folder truth with masks named <photo>_mask.png, and neither has any folder in it",
        path.display()
    )]
    NoTruth { path: PathBuf },
    #[error("cannot read {}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{} is not a mask", path.display())]
    Mask { path: PathBuf, source: PhotoError },
    #[error("{} is not a mesh", path.display())]
    Mesh {
        path: PathBuf,
        source: ReadMeshError,
    },
    #[error("{} is not JSON", path.display())]
    Json {
        path: PathBuf,
        source: serde_json::Error,
    },
    #[error(transparent)]
    Scan(#[from] ScanError),
    #[error(transparent)]
    Study(#[from] StudyError),
}

/// Scores of one scan, in the order of the tables
#[derive(Debug, Clone, PartialEq)]
pub struct ScanScore {
    /// Name of the scan folder
    pub scan: String,
    /// Names and values
    pub values: Vec<(String, f64)>,
}

impl ScanScore {
    /// Returns one value by its name
    pub fn get(&self, name: &str) -> Option<f64> {
        let entry = self.values.iter().find(|(n, _)| n == name);
        entry.map(|(_, value)| *value)
    }

    /// Returns all values by name, rounded to four decimals
    pub fn to_json(&self) -> Value {
        let mut object = Map::new();
        object.insert("scan".into(), json!(self.scan));
        for (name, value) in &self.values {
            object.insert(name.clone(), json!((value * 1e4).round() / 1e4));
        }
        Value::Object(object)
    }
}

/// Finds the folders with ground truth: each given folder, or otherwise its subfolders, by name
///
/// # Errors
/// When there are none, or a folder cannot be read.
pub fn with_truth(folders: &[PathBuf]) -> Result<Vec<PathBuf>, ScoreError> {
    let mut all = Vec::new();
    for folder in folders {
        if folder.join("truth").is_dir() {
            all.push(folder.clone());
            continue;
        }
        let mut inner: Vec<PathBuf> = list(folder)?
            .into_iter()
            .filter(|path| path.join("truth").is_dir())
            .collect();
        if inner.is_empty() {
            return Err(ScoreError::NoTruth {
                path: folder.clone(),
            });
        }
        all.append(&mut inner);
    }
    Ok(all)
}

/// Returns the name of a folder for tables
pub fn name_of(folder: &Path) -> String {
    let full = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = full.file_name().unwrap_or(full.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Scores a result folder against the truth of its scan
///
/// - `seg_iou`, `seg_worst`: overlap of `mask.png` with the true silhouettes, mean and worst; 0 for a view without a
///   mask
/// - `norm_iou`, `norm_iou_1`: overlap of `normalized.png` with the silhouettes of the person without sway, after the
///   best shift of each view, and after one shift for all (carving requires consistent views)
/// - `raw_iou`, `raw_iou_1`: the same for the true silhouettes in the photos, as a baseline
/// - `hull_mean_mm`, `hull_p95_mm`: surface error of the body
/// - `hull_volume_ratio`, `hull_stature_mm`: its volume relative to the true one, its height
/// - `girth_*_pct`: girths of the body at the true heights, error in percent
/// - `measure_*_mm`: measurements minus the true values
///
/// # Errors
/// When there are no true masks, or an existing file cannot be read.
pub fn score_scan(scan: &Path, result: &Path) -> Result<ScanScore, ScoreError> {
    let stems = stems(scan)?;
    let mut score = ScanScore {
        scan: name_of(scan),
        values: Vec::new(),
    };
    score_masks(&mut score, scan, result, &stems)?;
    let truth = scan.join("truth");
    let true_mm = measures(&truth.join("truth.json"))?;
    score_body(&mut score, &truth, result, &true_mm)?;
    let found_mm = measures(&result.join("measurements.json"))?;
    for (name, true_mm) in &true_mm {
        if let Some((_, found)) = found_mm.iter().find(|(n, _)| n == name) {
            put(
                &mut score,
                format!("measure_{name}_mm"),
                Some(found - true_mm),
            );
        }
    }
    Ok(score)
}

fn put(score: &mut ScanScore, name: impl Into<String>, value: Option<f64>) {
    if let Some(value) = value {
        score.values.push((name.into(), value));
    }
}

fn score_masks(
    score: &mut ScanScore,
    scan: &Path,
    result: &Path,
    stems: &[String],
) -> Result<(), ScoreError> {
    let read_all =
        |at: &(dyn Fn(&str) -> PathBuf + Sync)| -> Result<Vec<Option<Mask>>, ScoreError> {
            stems.par_iter().map(|stem| read_mask(&at(stem))).collect()
        };
    let truth = read_all(&|stem| scan.join("truth").join(format!("{stem}_mask.png")))?;
    let found = read_all(&|stem| result.join("views").join(stem).join("mask.png"))?;
    if found.iter().any(Option::is_some) {
        let overlaps: Vec<f64> = found
            .iter()
            .zip(&truth)
            .map(|(a, b)| overlap(a, b))
            .collect();
        put(score, "seg_iou", mean(&overlaps));
        put(
            score,
            "seg_worst",
            overlaps.iter().copied().min_by(f64::total_cmp),
        );
    }
    let canonical = read_all(&|stem| scan.join("truth").join(format!("{stem}_canonical.png")))?;
    let normalized = read_all(&|stem| result.join("views").join(stem).join("normalized.png"))?;
    if !normalized.iter().any(Option::is_some) {
        return Ok(());
    }
    for (name, masks) in [("norm", &normalized), ("raw", &truth)] {
        // A rejected view is scored as an empty mask.
        let pairs: Vec<(Mask, Mask)> = masks
            .iter()
            .zip(&canonical)
            .filter_map(|(mask, canonical)| {
                let canonical = halved(canonical.as_ref()?);
                let empty = || Mask::filled(canonical.width(), canonical.height(), false);
                Some((mask.as_ref().map_or_else(empty, halved), canonical))
            })
            .collect();
        let each: Vec<f64> = pairs
            .par_iter()
            .filter_map(|pair| best_shift_iou(std::slice::from_ref(pair)))
            .collect();
        put(score, format!("{name}_iou"), mean(&each));
        put(score, format!("{name}_iou_1"), best_shift_iou(&pairs));
    }
    Ok(())
}

/// Returns the overlap of two masks; 0 if one is missing or their sizes differ
fn overlap(found: &Option<Mask>, truth: &Option<Mask>) -> f64 {
    match (found, truth) {
        (Some(found), Some(truth)) if found.same_size(truth) => found.iou(truth),
        _ => 0.0,
    }
}

fn score_body(
    score: &mut ScanScore,
    truth: &Path,
    result: &Path,
    true_mm: &[(String, f64)],
) -> Result<(), ScoreError> {
    let Some(true_body) = read_body(truth)? else {
        return Ok(());
    };
    let Some(body) = read_body(result)? else {
        return Ok(());
    };
    let error = surface_error(&body, &true_body);
    put(score, "hull_mean_mm", error.as_ref().map(|e| e.mean_mm));
    put(score, "hull_p95_mm", error.as_ref().map(|e| e.p95_mm));
    let ratio = body.volume().abs() / true_body.volume().abs();
    put(
        score,
        "hull_volume_ratio",
        Some(ratio).filter(|r| r.is_finite()),
    );
    let stature = body.bounds().map(|(low, high)| high.y - low.y);
    put(score, "hull_stature_mm", stature);
    let truth_of = |name: String| true_mm.iter().find(|(n, _)| *n == name).map(|(_, v)| *v);
    for girth in ["bust", "waist", "hip"] {
        let found =
            truth_of(format!("{girth}_height")).and_then(|height| trunk_girth(&body, height));
        let ratio = found.zip(truth_of(format!("{girth}_girth")));
        let pct = ratio.map(|(found, truth)| 100.0 * (found / truth - 1.0));
        put(score, format!("girth_{girth}_pct"), pct);
    }
    Ok(())
}

/// Returns the scores as a table: a row for each score, a column for each scan
pub fn scan_table(scores: &[ScanScore]) -> Table {
    let mut columns = vec!["score"];
    columns.extend(scores.iter().map(|score| score.scan.as_str()));
    let mut table = Table::new("results against ground truth", &columns);
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in scores.iter().flat_map(|score| &score.values) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    for name in names {
        let decimals = match name {
            _ if name.ends_with("_mm") => 1,
            _ if name.ends_with("_pct") => 2,
            _ => 4,
        };
        let mut row = vec![Cell::Text(name.to_owned())];
        row.extend(scores.iter().map(|s| Cell::number(s.get(name), decimals)));
        table.rows.push(row);
    }
    table
}

/// Overlap of one photo's silhouette with the truth
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoScore {
    /// Folder and stem of the photo
    pub photo: String,
    /// Intersection over union; 0 without a silhouette
    pub iou: f64,
}

/// Segments photos independently and scores them
///
/// Includes every photo of the folders that has a true mask, also unusable ones.
///
/// # Errors
/// When a folder or its ground truth cannot be read, or the job was cancelled.
pub fn score_photos(
    folders: &[PathBuf],
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<Vec<PhotoScore>, ScoreError> {
    let mut jobs: Vec<(PathBuf, String)> = Vec::new();
    for folder in folders {
        jobs.extend(
            stems(folder)?
                .into_iter()
                .map(|stem| (folder.clone(), stem)),
        );
    }
    let scores = do_all(&jobs, cancel, on_step, |(folder, stem)| {
        let photo = match name_of(folder) {
            name if jobs.iter().filter(|(f, _)| f == folder).count() > 1 => {
                format!("{name}/{stem}")
            }
            name => name,
        };
        let (iou, text) = match segment_photo(folder, stem, cancel) {
            Ok(Ok(iou)) => (Ok(iou), format!("{photo}: {iou:.4}")),
            Ok(Err(error)) => (Ok(0.0), format!("{photo}: {error}")),
            Err(error) => {
                let text = format!("{photo}: {error}");
                (Err(error), text)
            }
        };
        (iou.map(|iou| PhotoScore { photo, iou }), text)
    })?;
    scores.into_iter().collect()
}

/// Returns the overlap of one photo's silhouette with the true one, or why there is none
fn segment_photo(
    folder: &Path,
    stem: &str,
    cancel: &CancelToken,
) -> Result<Result<f64, PipelineError>, ScoreError> {
    let path = folder.join("truth").join(format!("{stem}_mask.png"));
    let truth = read_mask(&path)?.ok_or(ScoreError::NoTruth { path })?;
    let options = LoadOptions {
        one_shape: false,
        ..LoadOptions::default()
    };
    let scan = load_scan(folder, &options)?.scan;
    let scan = Scan {
        views: scan.views.into_iter().filter(|v| v.name == *stem).collect(),
        ..scan
    };
    let config = Config::new(Goal::Segment, Method::Fit);
    Ok(run(&scan, &config, cancel, &mut |_| {}).map(|report| {
        report.views.first().map_or(0.0, |view| {
            let silhouette = &view.silhouette;
            if silhouette.mask.same_size(&truth) {
                return silhouette.mask.iou(&truth);
            }
            // The photo was shrunk on loading.
            let soft = resample(&silhouette.soft.to_grid(), truth.width(), truth.height());
            soft.threshold(0.5).iou(&truth)
        })
    }))
}

/// Returns median, mean and 10th percentile of the overlaps
pub fn photo_table(scores: &[PhotoScore]) -> Table {
    let mut table = Table::new(
        "silhouettes of single photos against ground truth, intersection over union",
        &["photos", "median", "mean", "p10"],
    );
    let values: Vec<f64> = scores.iter().map(|score| score.iou).collect();
    table.rows.push(vec![
        Cell::Number(values.len() as f64, 0),
        Cell::number(percentile(&values, 0.5), 4),
        Cell::number(mean(&values), 4),
        Cell::number(percentile(&values, 0.1), 4),
    ]);
    let worst = scores.iter().min_by(|a, b| a.iou.total_cmp(&b.iou));
    if let Some(worst) = worst {
        let note = format!("worst: {} ({:.4})", worst.photo, worst.iou);
        table.notes.push(note);
    }
    table
}

/// Returns the names of the views that have a true mask, sorted
fn stems(folder: &Path) -> Result<Vec<String>, ScoreError> {
    let truth = folder.join("truth");
    let no_truth = || ScoreError::NoTruth {
        path: folder.to_owned(),
    };
    if !truth.is_dir() {
        return Err(no_truth());
    }
    let files = list(&truth)?;
    let stems: Vec<String> = files
        .iter()
        .filter_map(|path| path.file_name()?.to_str()?.strip_suffix("_mask.png"))
        .map(str::to_owned)
        .collect();
    if stems.is_empty() {
        return Err(no_truth());
    }
    Ok(stems)
}

/// Lists a folder, sorted by name
fn list(folder: &Path) -> Result<Vec<PathBuf>, ScoreError> {
    let failed = |source| ScoreError::Read {
        path: folder.to_owned(),
        source,
    };
    let entries: Result<Vec<PathBuf>, io::Error> = fs::read_dir(folder)
        .map_err(failed)?
        .map(|entry| Ok(entry?.path()))
        .collect();
    let mut paths = entries.map_err(failed)?;
    paths.sort();
    Ok(paths)
}

/// Reads a file; `None` if it does not exist
fn read(path: &Path) -> Result<Option<Vec<u8>>, ScoreError> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(ScoreError::Read {
            path: path.to_owned(),
            source,
        }),
    }
}

fn read_mask(path: &Path) -> Result<Option<Mask>, ScoreError> {
    let Some(bytes) = read(path)? else {
        return Ok(None);
    };
    let mask = decode_mask(&bytes).map_err(|source| ScoreError::Mask {
        path: path.to_owned(),
        source,
    })?;
    Ok(Some(mask))
}

/// Reads `body` in the first available format
fn read_body(folder: &Path) -> Result<Option<TriMesh>, ScoreError> {
    type Reader = fn(&[u8]) -> Result<TriMesh, ReadMeshError>;
    let readers: [(&str, Reader); 3] = [
        ("body.ply", read_ply),
        ("body.obj", read_obj),
        ("body.off", read_off),
    ];
    for (name, reader) in readers {
        let path = folder.join(name);
        if let Some(bytes) = read(&path)? {
            let mesh = reader(&bytes).map_err(|source| ScoreError::Mesh { path, source })?;
            return Ok(Some(mesh));
        }
    }
    Ok(None)
}

/// Reads the numbers in `measurements_mm` of a file; empty if it does not exist
fn measures(path: &Path) -> Result<Vec<(String, f64)>, ScoreError> {
    let Some(bytes) = read(path)? else {
        return Ok(Vec::new());
    };
    let value: Value = serde_json::from_slice(&bytes).map_err(|source| ScoreError::Json {
        path: path.to_owned(),
        source,
    })?;
    let Some(measures) = value["measurements_mm"].as_object() else {
        return Ok(Vec::new());
    };
    let numbers = measures.iter();
    Ok(numbers
        .filter_map(|(name, value)| Some((name.clone(), value.as_f64()?)))
        .collect())
}
