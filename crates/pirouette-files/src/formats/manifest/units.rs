//! Values of a manifest in another unit than its key names.
//!
//! A mistake is an error, with the line to write, only if no person or camera can have the value as it is written.
//! The person's height decides whether a mass is given in pounds.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use super::{CameraFile, ManifestError, ManifestView};

/// A unit that values are mistakenly given in: values from `lowest` up to, but excluding, `end` are certainly in it
struct Mistake {
    unit: &'static str,
    lowest: f64,
    end: f64,
    /// What a value is multiplied by
    factor: f64,
}

const fn mistake(unit: &'static str, lowest: f64, end: f64, factor: f64) -> Mistake {
    Mistake {
        unit,
        lowest,
        end,
        factor,
    }
}

/// Who stands on a spot is 840 mm to 2700 mm tall in centimeters, and 1270 mm to 2130 mm in inches
const STATURE: [Mistake; 4] = [
    mistake("meters", 0.5, 2.7, 1000.0),
    mistake("feet", 3.5, 8.0, 304.8),
    mistake("inches", 50.0, 84.0, 25.4),
    mistake("centimeters", 84.0, 270.0, 10.0),
];

const MASS: [Mistake; 2] = [
    mistake("pounds", 400.0, 900.0, POUND_KG),
    mistake("grams", 10_000.0, 400_000.0, 0.001),
];

/// Lower lenses than 3 mm do not exist; phones at 80 to 130 mm show no complete person, those on furniture do
const CAMERA_HEIGHT: [Mistake; 2] = [
    mistake("meters", 0.2, 3.0, 1000.0),
    mistake("centimeters", 80.0, 130.0, 10.0),
];

/// At less than 600 mm, no camera shows a complete person
const CAMERA_DISTANCE: [Mistake; 2] = [
    mistake("meters", 0.6, 20.0, 1000.0),
    mistake("centimeters", 110.0, 600.0, 10.0),
];

const FIELD_OF_VIEW: [Mistake; 1] = [mistake("radians", 0.2, 2.0, 180.0 / PI)];

const POUND_KG: f64 = 0.453_592_37;

/// Body mass index, in kg/m², above which a mass is certainly given in pounds
///
/// As pounds, the same number is an index above 34; the highest indices on record at which people stand are below.
const HIGHEST_MASS_INDEX: f64 = 75.0;

/// Maximum difference of turn steps from an equal part of a turn, as a share of a turn; two decimals are written
const STEP_TOLERANCE_TURNS: f64 = 0.002;

/// Rejects a stature or mass that is certainly in another unit
pub(super) fn check_subject(
    stature_mm: Option<f64>,
    mass_kg: Option<f64>,
) -> Result<(), ManifestError> {
    check("subject", "stature_mm", stature_mm, &STATURE)?;
    check("subject", "mass_kg", mass_kg, &MASS)?;
    if let (Some(stature_mm), Some(mass_kg)) = (stature_mm, mass_kg)
        && mass_kg / (stature_mm / 1000.0).powi(2) > HIGHEST_MASS_INDEX
    {
        let pounds = mistake("pounds at this height", 0.0, f64::INFINITY, POUND_KG);
        check("subject", "mass_kg", Some(mass_kg), &[pounds])?;
    }
    Ok(())
}

/// Rejects values of the camera that are certainly in another unit
pub(super) fn check_camera(camera: &CameraFile) -> Result<(), ManifestError> {
    let of_camera = |name, value, mistakes| check("camera", name, value, mistakes);
    of_camera("height_mm", camera.height_mm, &CAMERA_HEIGHT)?;
    of_camera("distance_mm", camera.distance_mm, &CAMERA_DISTANCE)?;
    of_camera("vertical_fov_deg", camera.vertical_fov_deg, &FIELD_OF_VIEW)
}

fn check(
    object: &str,
    name: &'static str,
    value: Option<f64>,
    mistakes: &[Mistake],
) -> Result<(), ManifestError> {
    let Some(value) = value else {
        return Ok(());
    };
    let certain = |mistake: &&Mistake| (mistake.lowest..mistake.end).contains(&value);
    match mistakes.iter().find(certain) {
        Some(mistake) => Err(ManifestError::Unit {
            key: format!("{object}.{name}"),
            value,
            unit: mistake.unit,
            name,
            corrected: (value * mistake.factor * 10.0).round() / 10.0,
        }),
        None => Ok(()),
    }
}

/// Rejects turn angles in radians or turns: at least three, of which all steps are equal parts of a turn
pub(super) fn check_angles(views: &[ManifestView]) -> Result<(), ManifestError> {
    let mut angles: Vec<f64> = views.iter().filter_map(|view| view.angle_deg?).collect();
    angles.sort_by(f64::total_cmp);
    let (Some(&smallest), Some(&largest)) = (angles.first(), angles.last()) else {
        return Ok(());
    };
    if angles.len() < 3 || smallest < -TAU - 0.02 || largest > TAU + 0.02 {
        return Ok(());
    }
    for (unit, turn, parts) in [
        (
            "radians",
            TAU,
            vec![TAU / FRAC_PI_4, views.len() as f64, 12.0],
        ),
        ("turns", 1.0, vec![8.0, views.len() as f64, 12.0]),
    ] {
        let whole = |count: f64| (count - count.round()).abs() < STEP_TOLERANCE_TURNS * 8.0;
        let even = |parts: &f64| {
            let steps = angles
                .windows(2)
                .map(|pair| (pair[1] - pair[0]) / turn * parts);
            steps.clone().all(whole) && steps.sum::<f64>() >= 1.9
        };
        let inside = smallest >= -1.01 * turn && largest <= 1.01 * turn;
        if inside && parts.iter().any(even) {
            let value = angles.iter().copied().find(|&angle| angle > 0.0);
            let value = value.unwrap_or(smallest);
            return Err(ManifestError::AngleUnit {
                unit,
                value,
                corrected: (value / turn * 3600.0).round() / 10.0,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::parse_manifest;

    fn problem(json: &str) -> Option<String> {
        let read = parse_manifest(json.as_bytes());
        read.err().map(|error| error.to_string())
    }

    #[test]
    fn values_in_other_units_are_rejected_with_the_line_to_write() {
        for (object, name, value, unit, line) in [
            ("subject", "stature_mm", "174.8", "centimeters", "1748"),
            ("subject", "stature_mm", "1.748", "meters", "1748"),
            ("subject", "stature_mm", "68.8", "inches", "1747.5"),
            ("subject", "stature_mm", "5.75", "feet", "1752.6"),
            ("subject", "stature_mm", "174,8", "centimeters", "1748"),
            ("subject", "mass_kg", "64000", "grams", "64"),
            ("subject", "mass_kg", "420", "pounds", "190.5"),
            ("camera", "height_mm", "0.89", "meters", "890"),
            ("camera", "height_mm", "89", "centimeters", "890"),
            ("camera", "distance_mm", "2.4", "meters", "2400"),
            ("camera", "distance_mm", "240", "centimeters", "2400"),
            ("camera", "vertical_fov_deg", "0.874", "radians", "50.1"),
        ] {
            let json = format!("{{ \"{object}\": {{ \"{name}\": {value} }} }}");
            let message = problem(&json).unwrap_or_default();
            let right = format!("write \"{name}\": {line}");
            assert!(message.contains(unit), "{message}");
            assert!(message.ends_with(&right), "{message}");
        }
    }

    #[test]
    fn a_mass_in_pounds_is_rejected_if_nobody_of_this_height_has_it() {
        let message = problem(r#"{ "subject": { "stature_mm": 1500, "mass_kg": 180 } }"#);
        let message = message.unwrap_or_default();
        assert!(message.contains("pounds"), "{message}");
        assert!(message.ends_with("\"mass_kg\": 81.6"), "{message}");
        let heavy = r#"{ "subject": { "stature_mm": 1748, "mass_kg": 180 } }"#;
        assert_eq!(problem(heavy), None);
    }

    #[test]
    fn possible_values_are_accepted() {
        for json in [
            r#"{ "subject": { "stature_mm": 840, "mass_kg": 12 } }"#,
            r#"{ "camera": { "height_mm": 0, "distance_mm": 700, "vertical_fov_deg": 20 } }"#,
            r#"{ "camera": { "height_mm": 150 } }"#,
            r#"{ "camera": { "height_mm": 1500, "distance_mm": 20000 } }"#,
        ] {
            assert_eq!(problem(json), None);
        }
    }

    fn views(angles: &[f64]) -> String {
        let view = |(i, angle)| format!("{{ \"image\": \"{i}.jpg\", \"angle_deg\": {angle} }}");
        let views: Vec<String> = angles.iter().enumerate().map(view).collect();
        format!("{{ \"views\": [{}] }}", views.join(","))
    }

    #[test]
    fn angles_in_radians_or_turns_are_rejected() {
        let eighths: Vec<f64> = (0..8).map(f64::from).collect();
        let with = |step: f64| eighths.iter().map(|i| i * step).collect::<Vec<_>>();
        let message = problem(&views(&with(0.785))).unwrap_or_default();
        assert!(message.contains("radians"), "{message}");
        assert!(message.contains("\"angle_deg\": 45 "), "{message}");
        assert!(problem(&views(&[-1.571, 0.0, 1.571, std::f64::consts::PI])).is_some());
        let message = problem(&views(&with(0.125))).unwrap_or_default();
        assert!(message.contains("turns"), "{message}");
        for degrees in [with(45.0), with(0.5), vec![0.0; 8], vec![0.0, 1.571]] {
            assert_eq!(problem(&views(&degrees)), None);
        }
    }
}
