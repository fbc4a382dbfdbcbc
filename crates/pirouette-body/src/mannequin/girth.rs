//! Tape measures on the implicit body, and the section scales that fit them to the survey's values.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::field::{Field, Region, Sides};
use super::shape::{Anatomy, GirthScales, build};

/// Number of directions in which a section is sampled
const RAYS: usize = 48;

/// Number of rounds of building and measuring
const ROUNDS: usize = 8;

/// Position of one tape
struct Tape {
    scale: fn(&mut GirthScales) -> &mut f64,
    target_mm: f64,
    center: DVec3,
    /// Two directions that span the plane of the tape
    across: [DVec3; 2],
    regions: &'static [Region],
    sides: Sides,
}

/// Finds the factors that bring all tapes to their target values
pub(super) fn fit_girths(anatomy: &Anatomy) -> GirthScales {
    let mut scales = GirthScales::default();
    let tapes = tapes(anatomy);
    for _ in 0..ROUNDS {
        let field = build(&Anatomy {
            scales: &scales,
            ..*anatomy
        });
        for tape in &tapes {
            let measured = tape_girth(&field, tape);
            if measured > 0.0 {
                let factor = (tape.target_mm / measured).clamp(0.7, 1.4);
                *(tape.scale)(&mut scales) *= factor;
            }
        }
    }
    scales
}

fn tapes(a: &Anatomy) -> Vec<Tape> {
    let (d, frame) = (a.dimensions, a.frame);
    let trunk = |scale: fn(&mut GirthScales) -> &mut f64,
                 height: f64,
                 target_mm: f64,
                 regions: &'static [Region]| Tape {
        scale,
        target_mm,
        center: DVec3::new(0.0, height, frame.plumb_z),
        across: [DVec3::X, DVec3::Z],
        regions,
        sides: Sides::Both,
    };
    let leg = |scale: fn(&mut GirthScales) -> &mut f64, height: f64, target_mm: f64| {
        let t = (frame.hip.y - height) / (frame.hip.y - frame.ankle.y);
        Tape {
            scale,
            target_mm,
            center: frame.hip.lerp(frame.ankle, t),
            across: [DVec3::X, DVec3::Z],
            regions: &[Region::Leg],
            sides: Sides::Left,
        }
    };
    let arm = |scale: fn(&mut GirthScales) -> &mut f64,
               center: DVec3,
               axes: &glam::DMat3,
               target_mm: f64| Tape {
        scale,
        target_mm,
        center,
        across: [axes.x_axis, axes.z_axis],
        regions: &[Region::Arm, Region::Hand],
        sides: Sides::Left,
    };
    let neck = super::head::neck_axis(a);
    let neck_front = DVec3::X.cross((neck[1] - neck[0]).normalize_or(DVec3::Y));
    let levels = TapeLevels::new(a);
    vec![
        Tape {
            scale: |s| &mut s.neck,
            target_mm: d.neck_girth,
            center: neck[0].lerp(neck[1], NECK_TAPE),
            across: [DVec3::X, neck_front],
            regions: &[Region::Trunk, Region::Neck],
            sides: Sides::Both,
        },
        trunk(
            |s| &mut s.chest,
            levels.chest,
            d.chest_girth,
            &[Region::Trunk],
        ),
        trunk(
            |s| &mut s.waist,
            levels.waist,
            d.waist_girth,
            &[Region::Trunk],
        ),
        trunk(
            |s| &mut s.hip,
            levels.hip,
            d.hip_girth,
            &[Region::Trunk, Region::Leg],
        ),
        leg(|s| &mut s.thigh, levels.thigh, d.thigh_girth),
        leg(|s| &mut s.knee, levels.knee, d.lower_thigh_girth),
        leg(|s| &mut s.calf, levels.calf, d.calf_girth),
        leg(|s| &mut s.ankle, levels.ankle, d.ankle_girth),
        arm(
            |s| &mut s.upper_arm,
            frame.shoulder.lerp(frame.elbow, 0.5),
            &frame.upper_arm_axes,
            d.upper_arm_girth(),
        ),
        arm(
            |s| &mut s.forearm,
            frame.elbow.lerp(frame.wrist, 0.25),
            &frame.forearm_axes,
            d.forearm_girth(),
        ),
        arm(
            |s| &mut s.wrist,
            frame.elbow.lerp(frame.wrist, 0.97),
            &frame.forearm_axes,
            d.wrist_girth,
        ),
    ]
}

/// Position of the neck's tape along the neck's axis, as a share of it
const NECK_TAPE: f64 = 0.55;

/// Heights of the horizontal tapes, in mm
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub(super) struct TapeLevels {
    pub chest: f64,
    pub waist: f64,
    pub hip: f64,
    pub thigh: f64,
    pub knee: f64,
    pub calf: f64,
    pub ankle: f64,
}

impl TapeLevels {
    pub(super) fn new(a: &Anatomy) -> Self {
        let (d, m) = (a.dimensions, a.frame.permille_mm);
        Self {
            chest: d.chest_height,
            waist: d.waist_height,
            hip: d.buttock_height,
            thigh: d.crotch_height - 24.0 * m,
            // The survey measures the lower thigh just above the kneecap.
            knee: d.knee_height + 22.0 * m,
            calf: 0.77 * d.knee_height,
            ankle: 78.0 * m,
        }
    }
}

/// Computes the perimeter of the convex hull of the section, in mm; 0 when its center lies outside the body
fn tape_girth(field: &Field, tape: &Tape) -> f64 {
    let value = |p: DVec3| field.value_of(p, |r| tape.regions.contains(&r), tape.sides);
    let ray = |angle: f64| -> Option<DVec2> {
        let (sin, cos) = angle.sin_cos();
        let direction = tape.across[0] * sin + tape.across[1] * cos;
        let mut radius = 0.0;
        let mut before = None;
        for _ in 0..60 {
            let v = value(tape.center + direction * radius);
            if v > -1e-3 {
                // Hollows make the field steeper than a distance: a step can end outside.
                if let Some((inner, inside)) = before
                    && v > 1e-3
                {
                    radius = inner + (radius - inner) * inside / (inside - v);
                }
                break;
            }
            before = Some((radius, v));
            radius += -0.9 * v;
        }
        (radius > 0.0).then(|| DVec2::new(sin, cos) * radius)
    };
    let mut points: Vec<DVec2> = match tape.sides {
        // Both sides are alike: half the turn suffices.
        Sides::Both => {
            let half: Vec<DVec2> = (0..=RAYS / 2)
                .filter_map(|n| ray(PI * n as f64 / (RAYS / 2) as f64))
                .collect();
            let other = half.iter().rev().map(|p| DVec2::new(-p.x, p.y));
            half.iter().copied().chain(other).collect()
        }
        Sides::Left => (0..RAYS)
            .filter_map(|n| ray(TAU * n as f64 / RAYS as f64))
            .collect(),
    };
    if points.len() < RAYS / 2 {
        return 0.0;
    }
    hull_perimeter(&mut points) * CHORD_CORRECTION
}

/// Ratio of the perimeter of a circle to that of the inscribed polygon with `RAYS` corners
const CHORD_CORRECTION: f64 = 1.000_714;

/// Computes the perimeter of the convex hull (monotone chain)
fn hull_perimeter(points: &mut [DVec2]) -> f64 {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |forward: bool| -> f64 {
        let mut hull: Vec<DVec2> = Vec::new();
        let n = points.len();
        for i in 0..n {
            let p = points[if forward { i } else { n - 1 - i }];
            while hull.len() >= 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp_dot(p - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
        hull.windows(2).map(|w| w[0].distance(w[1])).sum()
    };
    chain(true) + chain(false)
}
