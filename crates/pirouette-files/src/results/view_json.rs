//! The content of `view.json`.

use glam::DVec2;
use serde_json::{Map, Value, json};

use super::rounded;
use pirouette::normalize::{JointPositions, LimbRefinement, Registration};
use pirouette::scan::View;
use pirouette::view::SolvedView;
use pirouette_body::{Bone, Joint};

/// Returns the content of `view.json`
pub(super) fn view_value(view: &View, found: &SolvedView) -> Value {
    let (width, height) = view.input_size_px;
    // All other coordinates are in px of the working photo.
    let scale = DVec2::new(
        width as f64 / view.photo.width() as f64,
        height as f64 / view.photo.height() as f64,
    );
    let detected = Joint::ALL.iter().filter_map(|&joint| {
        let keypoint = view.keypoints.found(joint)?;
        let p = keypoint.position * scale;
        let confidence = rounded(keypoint.confidence, 3);
        let entry = json!([rounded(p.x, 2), rounded(p.y, 2), confidence]);
        Some((joint.name().to_owned(), entry))
    });
    let mut value = json!({
        "name": view.name,
        "angle_deg": rounded(found.turn_in_use(view).degrees(), 3),
        "width_px": width,
        "height_px": height,
        "mask_given": view.mask.is_some(),
        "silhouette_from_avatar": found.silhouette.prior_used,
        "joints_px": { "detected": detected.collect::<Map<_, _>>() },
    });
    if let Some(normalized) = &found.normalized {
        let steps = [
            ("aligned", &normalized.joints.aligned),
            ("registered", &normalized.joints.registered),
            ("refined", &normalized.joints.refined),
        ];
        for (step, joints) in steps {
            value["joints_px"][step] = joints_value(joints, scale);
        }
        value["registration"] = normalized
            .registration
            .as_ref()
            .map_or(Value::Null, |found| registration_value(found, scale));
        let limbs = normalized
            .limbs
            .iter()
            .map(|limb| (limb.limb.name().to_owned(), limb_value(limb, scale)));
        value["limbs"] = Value::Object(limbs.collect());
        value["reference_iou"] = rounded(normalized.reference_iou, 4);
    }
    let fitted = found
        .fit
        .and_then(|fit| Some((fit.pose, fit.silhouette_iou?)));
    if let Some((_, iou)) = fitted {
        value["fit_iou"] = rounded(iou, 4);
    }
    let by_keypoints = || found.skeleton.map(|skeleton| skeleton.pose);
    if let Some(pose) = fitted.map(|(pose, _)| pose).or_else(by_keypoints) {
        let rotations = Bone::ALL
            .iter()
            .map(|&bone| {
                let degrees = pose.rotations[bone].to_array();
                let degrees = degrees.map(|r| rounded(r.to_degrees(), 2));
                (bone.name().to_owned(), json!(degrees))
            })
            .collect::<Map<_, _>>();
        value["pose"] = json!({
            "rotations_deg": rotations,
            "shift_mm": pose.shift_mm.to_array().map(|v| rounded(v, 1)),
        });
    }
    value
}

fn joints_value(joints: &JointPositions, scale: DVec2) -> Value {
    let entries = Joint::ALL.iter().filter_map(|&joint| {
        let p = joints[joint]? * scale;
        let entry = json!([rounded(p.x, 2), rounded(p.y, 2)]);
        Some((joint.name().to_owned(), entry))
    });
    Value::Object(entries.collect())
}

/// Returns the rigid motion onto the reference, and the mean contour distance before and after
fn registration_value(found: &Registration, scale: DVec2) -> Value {
    let shift = found.translation_px * scale;
    let center = found.center * scale;
    json!({
        "rotation_deg": rounded(found.rotation_radians.to_degrees(), 3),
        "center_px": [rounded(center.x, 2), rounded(center.y, 2)],
        "translation_px": [rounded(shift.x, 2), rounded(shift.y, 2)],
        "error_before_px": rounded(found.mean_distance_before_px * scale.y, 3),
        "error_after_px": rounded(found.mean_distance_after_px * scale.y, 3),
    })
}

/// Returns the angles of a limb's chain, and the mean contour distance before and after
fn limb_value(limb: &LimbRefinement, scale: DVec2) -> Value {
    json!({
        "upper_deg": rounded(limb.upper_radians.to_degrees(), 2),
        "lower_deg": rounded(limb.lower_radians.to_degrees(), 2),
        "error_before_px": rounded(limb.mean_distance_before_px * scale.y, 3),
        "error_after_px": rounded(limb.mean_distance_after_px * scale.y, 3),
    })
}
