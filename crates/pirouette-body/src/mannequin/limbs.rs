//! Arms without hands, legs without feet.

use std::f64::consts::TAU;

use glam::DVec2;

use super::field::{Field, Region};
use super::primitives::{Curve, Section, Shape, Tube};
use super::shape::Anatomy;

/// One row of the leg's table
///
/// Height in per mille; radii to the outside, inside, front and back in multiples of the girth's radius; shift of the center
/// off the line from hip to ankle, outward and to the front, in per mille.
type LegRow = [f64; 7];

/// The leg of an average adult; women and men differ by their girths
const LEG: [LegRow; 16] = [
    [520.0, 0.95, 0.80, 0.95, 0.95, 0.0, 10.0],
    [490.0, 1.00, 0.92, 1.00, 1.05, -1.0, 13.0],
    [455.0, 0.99, 0.98, 1.02, 1.06, -1.5, 15.0],
    [420.0, 0.97, 0.97, 1.04, 1.02, -1.5, 17.0],
    [385.0, 0.97, 0.97, 1.05, 1.00, -2.0, 17.5],
    [350.0, 0.98, 0.98, 1.04, 0.98, -2.0, 17.0],
    [315.0, 1.00, 1.00, 1.02, 1.00, -1.0, 14.5],
    [280.0, 0.98, 1.00, 1.05, 0.98, 3.0, 8.0],
    [255.0, 0.99, 0.99, 1.00, 0.98, 6.0, -0.5],
    [215.0, 1.00, 1.00, 0.98, 1.02, 7.5, -6.0],
    [175.0, 0.98, 0.98, 0.98, 1.02, 6.5, -7.5],
    [140.0, 0.97, 0.97, 1.00, 1.00, 5.5, -7.0],
    [105.0, 0.90, 0.90, 1.05, 1.08, 5.0, -6.0],
    [75.0, 0.86, 0.86, 1.06, 1.12, 3.5, -5.0],
    [48.0, 0.88, 0.88, 1.06, 1.10, 2.0, -4.0],
    [26.0, 0.70, 0.70, 0.85, 0.75, 1.0, 0.0],
];

/// Girth of the leg along its height in per mille, as a blend of the four tapes: thigh, knee, calf, ankle
const LEG_GIRTH: [[f64; 5]; 16] = [
    [520.0, 0.98, 0.0, 0.0, 0.0],
    [490.0, 1.01, 0.0, 0.0, 0.0],
    [455.0, 1.0, 0.0, 0.0, 0.0],
    [420.0, 0.92, 0.05, 0.0, 0.0],
    [385.0, 0.75, 0.22, 0.0, 0.0],
    [350.0, 0.46, 0.48, 0.0, 0.0],
    [315.0, 0.15, 0.83, 0.0, 0.0],
    [280.0, 0.0, 0.985, 0.0, 0.0],
    [255.0, 0.0, 0.55, 0.40, 0.0],
    [215.0, 0.0, 0.0, 1.0, 0.0],
    [175.0, 0.0, 0.0, 0.95, 0.0],
    [140.0, 0.0, 0.0, 0.60, 0.40],
    [105.0, 0.0, 0.0, 0.15, 0.88],
    [75.0, 0.0, 0.0, 0.0, 1.0],
    [48.0, 0.0, 0.0, 0.0, 1.08],
    [26.0, 0.0, 0.0, 0.0, 1.0],
];

/// Heights of the leg tables' landmarks, in per mille: malleolus, kneecap, crotch, trochanter
const LEG_LANDMARKS: [f64; 4] = [40.5, 277.0, 481.0, 516.0];

/// Adds the left leg and its mirror image
pub(super) fn add_leg(field: &mut Field, a: &Anatomy) {
    let (d, frame) = (a.dimensions, a.frame);
    let m = frame.permille_mm;
    let height = Curve::new(
        LEG_LANDMARKS
            .into_iter()
            .zip([
                d.malleolus_height,
                d.knee_height,
                d.crotch_height,
                d.trochanter_height,
            ])
            .collect(),
    );
    let tapes = [
        d.thigh_girth * a.scales.thigh,
        d.lower_thigh_girth * a.scales.knee,
        d.calf_girth * a.scales.calf,
        d.ankle_girth * a.scales.ankle,
    ];
    let cosine = -frame.leg_axes.y_axis.y;
    let keys: Vec<(f64, Section)> = LEG
        .iter()
        .zip(&LEG_GIRTH)
        .map(|(row, blend)| {
            let girth: f64 = tapes.iter().zip(&blend[1..]).map(|(g, b)| g * b).sum();
            // High up in the hips the leg is part of the hip girth.
            let in_hip = ((row[0] - 470.0) / 40.0).clamp(0.0, 1.0);
            // Women's thighs and calves lie slightly farther in front of the ankle.
            let bow = a.by_sex(4.0, -4.0) * ((row[0] - 75.0) / 100.0).clamp(0.0, 1.0);
            let radius = girth / TAU * a.scales.hip.powf(in_hip);
            let section = Section {
                center: DVec2::new(row[5], row[6] + bow) * m,
                outer: row[1] * radius,
                inner: row[2] * radius,
                front: row[3] * radius,
                back: row[4] * radius,
                square_front: 0.0,
                square_back: 0.0,
            };
            let y = if row[0] <= LEG_LANDMARKS[0] || row[0] >= LEG_LANDMARKS[3] {
                row[0] * m
            } else {
                height.at(row[0])
            };
            ((frame.hip.y - y) / cosine, section)
        })
        .collect();
    let tube = Tube::new(frame.hip, frame.leg_axes, &keys, [40.0 * m, 10.0 * m]).smoothed(7.0 * m);
    field.add_pair(Region::Leg, Shape::Tube(tube), 28.0 * m, 14.0 * m);
}

/// One row of an arm's table: station as a share of the bone, radii to the upper side, under side, front (thumb side) and
/// back in multiples of the girth's radius, shift to the upper side and to the front in the same
type ArmRow = [f64; 7];

const UPPER_ARM: [ArmRow; 7] = [
    [-0.04, 1.16, 1.00, 1.14, 1.14, 0.04, 0.0],
    [0.12, 1.22, 1.10, 1.20, 1.18, 0.04, 0.0],
    [0.28, 1.15, 1.06, 1.14, 1.11, 0.02, 0.0],
    [0.50, 0.99, 0.99, 1.03, 0.99, 0.0, 0.02],
    [0.75, 0.92, 0.92, 0.96, 0.94, 0.0, 0.02],
    [0.93, 0.90, 0.90, 0.84, 0.86, 0.0, 0.0],
    [1.0, 0.78, 0.76, 0.66, 0.70, 0.0, 0.02],
];

const FOREARM: [ArmRow; 6] = [
    [-0.02, 0.80, 0.80, 0.80, 0.80, 0.0, 0.04],
    [0.10, 0.94, 0.94, 1.03, 1.0, 0.0, 0.03],
    [0.28, 0.96, 0.96, 1.03, 1.0, 0.0, 0.02],
    [0.55, 0.86, 0.86, 0.95, 0.92, 0.0, 0.0],
    [0.82, 0.80, 0.80, 1.05, 1.05, 0.0, 0.0],
    [1.06, 0.78, 0.78, 1.16, 1.16, 0.0, 0.0],
];

/// Girth along the forearm as a blend of largest girth and wrist, per row of `FOREARM`
const FOREARM_GIRTH: [[f64; 2]; 6] = [
    [0.98, 0.0],
    [1.0, 0.0],
    [0.98, 0.0],
    [0.62, 0.42],
    [0.10, 0.95],
    [0.0, 1.0],
];

fn arm_section(row: &ArmRow, radius: f64) -> Section {
    Section {
        center: DVec2::new(row[5], row[6]) * radius,
        outer: row[1] * radius,
        inner: row[2] * radius,
        front: row[3] * radius,
        back: row[4] * radius,
        square_front: 0.0,
        square_back: 0.0,
    }
}

/// Adds the left arm and its mirror image
pub(super) fn add_arm(field: &mut Field, a: &Anatomy) {
    let (d, frame) = (a.dimensions, a.frame);
    let m = frame.permille_mm;
    let radius = d.upper_arm_girth() * a.scales.upper_arm / TAU;
    let length = frame.shoulder.distance(frame.elbow);
    let keys: Vec<(f64, Section)> = UPPER_ARM
        .iter()
        .map(|row| (row[0] * length, arm_section(row, radius)))
        .collect();
    let tube = Tube::new(
        frame.shoulder,
        frame.upper_arm_axes,
        &keys,
        [0.95 * radius, 0.45 * radius],
    );
    field.add_pair(Region::Arm, Shape::Tube(tube), 10.0 * m, 1.0);

    let tapes = [
        d.forearm_girth() * a.scales.forearm,
        d.wrist_girth * a.scales.wrist,
    ];
    let length = frame.elbow.distance(frame.wrist);
    let keys: Vec<(f64, Section)> = FOREARM
        .iter()
        .zip(&FOREARM_GIRTH)
        .map(|(row, blend)| {
            let girth = tapes[0] * blend[0] + tapes[1] * blend[1];
            (row[0] * length, arm_section(row, girth / TAU))
        })
        .collect();
    let tube = Tube::new(
        frame.elbow,
        frame.forearm_axes,
        &keys,
        [0.5 * tapes[0] / TAU, 10.0 * m],
    );
    field.add_pair(Region::Arm, Shape::Tube(tube), 10.0 * m, 1.0);
}
