//! Differences between two results of one person: measures at the same levels, and a body colored by its changes.

use std::path::{Path, PathBuf};

use glam::DVec3;
use pirouette::measure::Measure;
use pirouette_geom::TriMesh;
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::section::{plane_section, tape_length};
use serde_json::{Value, json};
use thiserror::Error;

use crate::formats::mesh::{ReadMeshError, read_ply};

/// Why a result folder cannot be compared
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CompareError {
    /// A file cannot be read
    #[error("cannot read {path}; give a result folder of 'pirouette scan' or 'pirouette measure'")]
    Read {
        /// The file
        path: PathBuf,
        /// Cause
        source: std::io::Error,
    },
    /// `measurements.json` is damaged
    #[error("{path} contains no measurements")]
    Measurements {
        /// The file
        path: PathBuf,
    },
    /// Lengths are in units of the stature
    #[error(
        "{path} is in units of the stature: results without a scale cannot be compared; scan again with the stature"
    )]
    NoScale {
        /// The file
        path: PathBuf,
    },
    /// `body.ply` is damaged
    #[error("{path}")]
    Body {
        /// The file
        path: PathBuf,
        /// Cause
        source: ReadMeshError,
    },
}

/// A result to compare
#[derive(Debug, Clone, PartialEq)]
pub struct ComparedResult {
    /// Content of `measurements.json`
    pub measurements: Value,
    /// The body, world frame, mm; if `body.ply` is there
    pub body: Option<TriMesh>,
}

impl ComparedResult {
    /// Reads `measurements.json` and `body.ply` of a result folder
    ///
    /// # Errors
    /// When a file cannot be read, or its lengths are in units of the stature.
    pub fn read(folder: &Path) -> Result<Self, CompareError> {
        let path = folder.join("measurements.json");
        let bytes = std::fs::read(&path).map_err(|source| CompareError::Read {
            path: path.clone(),
            source,
        })?;
        let measurements: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        if !measurements["measurements_mm"].is_object() {
            return Err(CompareError::Measurements { path });
        }
        if measurements["unit"] != "mm" {
            return Err(CompareError::NoScale { path });
        }
        let path = folder.join("body.ply");
        let body = match std::fs::read(&path) {
            Ok(bytes) => {
                let body = read_ply(&bytes);
                Some(body.map_err(|source| CompareError::Body { path, source })?)
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(source) => return Err(CompareError::Read { path, source }),
        };
        Ok(Self { measurements, body })
    }

    fn value(&self, measure: Measure) -> Option<f64> {
        self.measurements["measurements_mm"][measure.name()].as_f64()
    }

    /// Returns whether a measure is an estimate below clothes, which are the surface of the body here
    fn is_below_clothes(&self, measure: Measure) -> bool {
        self.measurements["details"][measure.name()]["method"] == "below_clothes"
    }

    fn detail(&self, measure: Measure, key: &str) -> Option<f64> {
        self.measurements["details"][measure.name()][key].as_f64()
    }
}

/// The change of one measure from a first to a second result, in mm
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// The measure
    pub measure: Measure,
    /// Value of the first result
    pub first_mm: f64,
    /// Value of the second result
    pub second_mm: f64,
    /// Second less first; of girths of the trunk at the level of the first
    pub difference_mm: f64,
    /// Standard deviation of the difference
    pub sd_mm: f64,
    /// Whether both were measured at the level of the first
    pub same_level: bool,
}

/// A difference beyond this many standard deviations is a change
const CHANGE_SIGMAS: f64 = 2.0;

impl Change {
    /// Returns whether the difference is larger than chance explains: 5 % of unchanged measures are
    pub fn is_beyond_chance(&self) -> bool {
        self.difference_mm.abs() > CHANGE_SIGMAS * self.sd_mm
    }

    /// Returns the change as an object of `compare.json`
    pub fn to_json(&self) -> Value {
        let tenths = |value: f64| (value * 10.0).round() / 10.0;
        json!({
            "measure": self.measure.name(),
            "first_mm": tenths(self.first_mm),
            "second_mm": tenths(self.second_mm),
            "difference_mm": tenths(self.difference_mm),
            "sd_mm": tenths(self.sd_mm),
            "same_level": self.same_level,
            "beyond_chance": self.is_beyond_chance(),
        })
    }
}

/// Compares all measures that both results have
///
/// A girth of the trunk changes with its level: both bodies are measured at the level of the first, at the same share of
/// the stature. Standard deviations contain the scale only once, if both statures were stated alike.
pub fn compare(first: &ComparedResult, second: &ComparedResult) -> Vec<Change> {
    let stature = |result: &ComparedResult| result.value(Measure::Stature);
    let statures = stature(first).zip(stature(second));
    let stated = |result: &ComparedResult| result.measurements["scale"] == "stature";
    let one_scale = stated(first) && stated(second) && statures.is_some_and(|(a, b)| a == b);
    let change = |measure: Measure| {
        let (first_mm, second_mm) = (first.value(measure)?, second.value(measure)?);
        let locked = locked_difference(first, second, measure, statures);
        let difference_mm = locked.unwrap_or(second_mm - first_mm);
        let own = |result: &ComparedResult| {
            let [sd, scale] = ["sd_mm", "scale_sd_mm"].map(|key| result.detail(measure, key));
            let (sd, scale) = (sd?, scale.unwrap_or(0.0));
            Some(((sd * sd - scale * scale).max(0.0).sqrt(), scale))
        };
        let ((a, scale_a), (b, scale_b)) = (own(first)?, own(second)?);
        let scale_mm = match one_scale {
            true => scale_a * difference_mm / first_mm,
            false => scale_a.hypot(scale_b),
        };
        Some(Change {
            measure,
            first_mm,
            second_mm,
            difference_mm,
            sd_mm: a.hypot(b).hypot(scale_mm),
            same_level: locked.is_some(),
        })
    };
    Measure::ALL.into_iter().filter_map(change).collect()
}

/// Girths of the trunk that are compared at the level of the first result: the arms are apart from them
const LOCKED: [Measure; 5] = [
    Measure::UnderbustGirth,
    Measure::NarrowestWaistGirth,
    Measure::WaistGirth,
    Measure::HighHipGirth,
    Measure::HipGirth,
];

/// A section differs from the tape by less than this share, or it belongs to other parts of the body
const SECTION_TOLERANCE: f64 = 0.03;

/// Returns the difference of a girth at the level of the first body; `None` without bodies or sections of the trunk, and for
/// estimates below clothes
fn locked_difference(
    first: &ComparedResult,
    second: &ComparedResult,
    measure: Measure,
    statures: Option<(f64, f64)>,
) -> Option<f64> {
    if [first, second]
        .iter()
        .any(|result| result.is_below_clothes(measure))
    {
        return None;
    }
    let (first_body, second_body) = (first.body.as_ref()?, second.body.as_ref()?);
    let (first_stature, second_stature) = statures?;
    let level_mm = first
        .detail(measure, "level_mm")
        .filter(|_| LOCKED.contains(&measure))?;
    let first_mm = trunk_girth(first_body, level_mm)?;
    let second_mm = trunk_girth(second_body, level_mm * second_stature / first_stature)?;
    let as_taped = (first_mm / first.value(measure)? - 1.0).abs() < SECTION_TOLERANCE;
    as_taped.then_some(second_mm - first_mm)
}

/// Returns the length of a tape around the largest section of a body at a level
fn trunk_girth(body: &TriMesh, level_mm: f64) -> Option<f64> {
    let loops = plane_section(body, DVec3::Y * level_mm, DVec3::Y);
    loops
        .iter()
        .map(|points| tape_length(points))
        .reduce(f64::max)
}

/// Changes up to this are not visible in the colors, in mm; those from the second value on have the full color
const COLORED_MM: [f64; 2] = [3.0, 20.0];

const UNCHANGED: [f64; 3] = [205.0, 205.0, 205.0];
const LARGER: [f64; 3] = [200.0, 40.0, 30.0];
const SMALLER: [f64; 3] = [30.0, 80.0, 200.0];

/// Returns a color for each vertex of the second body: red where it is larger than the first, blue where smaller
///
/// Both are in the reference pose, world frame, mm; they are placed over each other by their middles.
pub fn change_colors(first: &TriMesh, second: &TriMesh) -> Vec<[u8; 3]> {
    let middle = |mesh: &TriMesh| {
        let sum: DVec3 = mesh.positions.iter().sum();
        sum / mesh.positions.len().max(1) as f64
    };
    let shift = (middle(first) - middle(second)) * DVec3::new(1.0, 0.0, 1.0);
    let surface = NearestSurface::new(first);
    let color = |point: &DVec3| {
        let point = *point + shift;
        let change_mm = surface.nearest(point).map_or(0.0, |near| {
            let [a, b, c] = first.corners(near.triangle);
            let outward = (b - a).cross(c - a);
            let off = point - near.position;
            if off.dot(outward) < 0.0 {
                -near.distance
            } else {
                near.distance
            }
        });
        let [from, full] = COLORED_MM;
        let share = ((change_mm.abs() - from) / (full - from)).clamp(0.0, 1.0);
        let target = if change_mm > 0.0 { LARGER } else { SMALLER };
        std::array::from_fn(|k| (UNCHANGED[k] + (target[k] - UNCHANGED[k]) * share) as u8)
    };
    second.positions.par_iter().map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette::measure::{MeasureInput, measure};
    use pirouette_body::Sex;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    use crate::report::json::measurements_json;

    fn result(mass_kg: f64) -> ComparedResult {
        let avatar = mannequin(&MannequinParameters {
            sex: Sex::Female,
            stature_mm: Some(1680.0),
            mass_kg: Some(mass_kg),
            ..MannequinParameters::default()
        })
        .expect("a usual woman");
        let measurements = measure(&MeasureInput::of_avatar(&avatar));
        ComparedResult {
            measurements: measurements_json(&measurements, &[]),
            body: Some(avatar.mesh),
        }
    }

    #[test]
    fn a_result_does_not_differ_from_itself() {
        let before = result(62.0);
        let changes = compare(&before, &before);
        assert!(changes.len() > 40);
        for change in changes {
            assert!(change.difference_mm.abs() < 1e-9, "{change:?}");
            assert!(!change.is_beyond_chance());
        }
        let body = before.body.unwrap();
        let colors = change_colors(&body, &body);
        assert!(
            colors
                .iter()
                .all(|color| *color == UNCHANGED.map(|c| c as u8))
        );
    }

    #[test]
    fn estimates_below_clothes_are_compared_by_their_values() {
        let (before, mut after) = (result(62.0), result(74.0));
        let name = Measure::HipGirth.name();
        after.measurements["details"][name]["method"] = serde_json::json!("below_clothes");
        after.measurements["measurements_mm"][name] = serde_json::json!(1000.0);
        let changes = compare(&before, &after);
        let hip = changes
            .iter()
            .find(|c| c.measure == Measure::HipGirth)
            .unwrap();
        assert!(!hip.same_level);
        assert_eq!(hip.difference_mm, hip.second_mm - hip.first_mm);
    }

    #[test]
    fn more_mass_is_a_change_of_girths_at_the_same_level_and_not_of_heights() {
        let (before, after) = (result(62.0), result(74.0));
        let changes = compare(&before, &after);
        let of = |measure| changes.iter().find(|c| c.measure == measure).unwrap();
        let waist = of(Measure::WaistGirth);
        assert!(waist.same_level && waist.is_beyond_chance(), "{waist:?}");
        assert!((40.0..160.0).contains(&waist.difference_mm), "{waist:?}");
        assert!(!of(Measure::NapeHeight).is_beyond_chance());
        assert_eq!(of(Measure::Stature).sd_mm, 0.0);
        let back = compare(&after, &before);
        let hip = |changes: &[Change]| {
            let change = changes.iter().find(|c| c.measure == Measure::HipGirth);
            change.unwrap().difference_mm
        };
        // Not exactly opposite: each is at the level of its first result.
        assert!((hip(&changes) + hip(&back)).abs() < 15.0);
        let colors = change_colors(before.body.as_ref().unwrap(), after.body.as_ref().unwrap());
        let red = colors.iter().filter(|[r, _, b]| r > b).count();
        let blue = colors.iter().filter(|[r, _, b]| b > r).count();
        assert!(red > 4 * blue, "{red} {blue}");
    }

    #[test]
    fn another_stature_adds_the_uncertainty_of_the_scale() {
        let before = result(62.0);
        let mut after = before.clone();
        after.measurements["measurements_mm"]["stature"] = json!(1681.0);
        let sd = |after: &ComparedResult| {
            let changes = compare(&before, after);
            let hip = changes.iter().find(|c| c.measure == Measure::HipGirth);
            hip.unwrap().sd_mm
        };
        assert!(sd(&after) > 1.5 * sd(&before));
    }

    #[test]
    fn a_folder_without_measurements_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = |folder: &Path| ComparedResult::read(folder).unwrap_err().to_string();
        assert!(error(folder.path()).contains("measurements.json"));
        let file = folder.path().join("measurements.json");
        std::fs::write(&file, "{").unwrap();
        assert!(error(folder.path()).contains("contains no measurements"));
        std::fs::write(&file, r#"{"measurements_mm": {}, "unit": "stature"}"#).unwrap();
        assert!(error(folder.path()).contains("units of the stature"));
        std::fs::write(&file, r#"{"measurements_mm": {}, "unit": "mm"}"#).unwrap();
        let read = ComparedResult::read(folder.path()).unwrap();
        assert_eq!(compare(&read, &read), []);
        std::fs::write(folder.path().join("body.ply"), "ply\nx").unwrap();
        assert!(error(folder.path()).contains("body.ply"));
    }
}
