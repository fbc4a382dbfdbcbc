//! Hands with slightly spread fingers and feet with toes.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::field::{Field, Region};
use super::frame::Frame;
use super::primitives::{Section, Shape, Tube};
use super::proportions::Proportions;
use super::shape::Anatomy;

/// Bend of the fingers towards the palm, in degrees, spread about evenly over their length
///
/// Relaxed hands bend twice as far, but people hold them open for a scan.
const FINGER_CURL_DEGREES: f64 = 9.0;

/// Outward angle of a standing person's feet, in degrees
const TOE_OUT_DEGREES: f64 = 5.0;

/// Share of the foot's length behind the ankle joint
const HEEL_SHARE: f64 = 0.248;

/// Adds the left hand and its mirror image
pub(super) fn add_hand(field: &mut Field, a: &Anatomy) {
    let (d, frame) = (a.dimensions, a.frame);
    let (length, half) = (d.hand_length, d.hand_breadth / 2.0);
    let wrist_radius = d.wrist_girth * a.scales.wrist / std::f64::consts::TAU;
    // Rows: station over hand length, back of the hand, palm, thumb side, little finger side over half the breadth.
    let section = |back: f64, palm: f64, thumb: f64, little: f64, square: f64| Section {
        center: DVec2::ZERO,
        outer: back * half,
        inner: palm * half,
        front: thumb * half,
        back: little * half,
        square_front: square,
        square_back: square,
    };
    let wrist = wrist_radius / half;
    let start = frame.stylion;
    let palm = [
        // Begins inside the forearm: coincident surfaces would bulge where they blend.
        (
            -0.12 * length,
            section(0.60 * wrist, 0.60 * wrist, 0.80 * wrist, 0.80 * wrist, 0.1),
        ),
        (0.06 * length, section(0.39, 0.44, 0.74, 0.72, 0.3)),
        (0.24 * length, section(0.32, 0.40, 0.90, 0.88, 0.5)),
        (0.42 * length, section(0.28, 0.32, 0.98, 0.98, 0.6)),
        (0.53 * length, section(0.20, 0.24, 0.94, 0.95, 0.6)),
    ];
    let tube = Tube::new(start, frame.forearm_axes, &palm, [6.0, 0.10 * length]).smoothed(8.0);
    field.add_pair(Region::Hand, Shape::Tube(tube), 10.0, 1.0);

    let bend = |degrees: f64| {
        DMat3::from_quat(DQuat::from_axis_angle(
            frame.forearm_axes.z_axis,
            curl_sign(&frame.forearm_axes) * degrees.to_radians(),
        )) * frame.forearm_axes
    };
    // Two bones each: from the knuckle to the middle joint, and the remainder.
    let (near, far) = (
        bend(0.6 * FINGER_CURL_DEGREES),
        bend(1.6 * FINGER_CURL_DEGREES),
    );
    let at = |along: f64, thumb: f64, back: f64| {
        start + frame.forearm_axes * DVec3::new(back * half, along * length, thumb * half)
    };
    for finger in FINGERS {
        let (sin, cos) = finger.spread_degrees.to_radians().sin_cos();
        let radius = finger.radius * half;
        let reach = finger.reach * length;
        let knuckle = at(finger.knuckle, finger.across, -0.02);
        let joint = knuckle + (near.y_axis * cos + near.z_axis * sin) * (0.45 * reach);
        let tip = joint + (far.y_axis * cos + far.z_axis * sin) * (0.55 * reach - 0.8 * radius);
        for (from, to, radii, blend) in [
            (knuckle, joint, [1.12 * radius, 0.98 * radius], 8.0),
            (joint, tip, [0.98 * radius, 0.80 * radius], 2.0),
        ] {
            let bone = Shape::Cone { from, to, radii };
            field.add_pair(Region::Hand, bone, blend, 1.0);
        }
    }
    let (root, joint, tip) = (
        at(0.10, 0.50, -0.20),
        at(0.33, 1.02, -0.55),
        at(0.55, 1.26, -0.90),
    );
    let ball = Shape::Cone {
        from: root,
        to: joint,
        radii: [0.42 * half, 0.27 * half],
    };
    field.add_pair(Region::Hand, ball, 14.0, 1.0);
    let thumb = Shape::Cone {
        from: joint,
        to: tip,
        radii: [0.26 * half, 0.19 * half],
    };
    field.add_pair(Region::Hand, thumb, 4.0, 1.0);
}

/// One finger, without the thumb
struct Finger {
    /// Knuckle: share of the hand's length, and across it over half its breadth, positive to the thumb
    knuckle: f64,
    across: f64,
    /// Knuckle to tip over the hand's length
    reach: f64,
    /// Over half the hand's breadth
    radius: f64,
    spread_degrees: f64,
}

/// Index, middle, ring and little finger of a hand held open without effort
const FINGERS: [Finger; 4] = [
    Finger {
        knuckle: 0.50,
        across: 0.68,
        reach: 0.47,
        radius: 0.215,
        spread_degrees: 14.0,
    },
    Finger {
        knuckle: 0.51,
        across: 0.22,
        reach: 0.52,
        radius: 0.22,
        spread_degrees: 4.0,
    },
    Finger {
        knuckle: 0.49,
        across: -0.24,
        reach: 0.49,
        radius: 0.21,
        spread_degrees: -6.0,
    },
    Finger {
        knuckle: 0.46,
        across: -0.68,
        reach: 0.40,
        radius: 0.185,
        spread_degrees: -17.0,
    },
];

/// Sign of the rotation about the thumb side that bends the fingers towards the palm (away from the upper side)
fn curl_sign(axes: &DMat3) -> f64 {
    if axes.z_axis.cross(axes.y_axis).dot(axes.x_axis) > 0.0 {
        -1.0
    } else {
        1.0
    }
}

/// The left foot: its position and direction
#[derive(Debug, Clone, Copy)]
pub(super) struct FootPlan {
    heel: DVec3,
    axes: DMat3,
    length: f64,
    half_breadth: f64,
}

impl FootPlan {
    pub(super) fn new(d: &Proportions, frame: &Frame) -> Self {
        let (sin, cos) = TOE_OUT_DEGREES.to_radians().sin_cos();
        let forward = DVec3::new(sin, 0.0, cos);
        let axes = DMat3::from_cols(DVec3::new(cos, 0.0, -sin), forward, DVec3::Y);
        let below = DVec3::new(frame.ankle.x, 0.0, frame.ankle.z);
        Self {
            heel: below - forward * (HEEL_SHARE * d.foot_length),
            axes,
            length: d.foot_length,
            half_breadth: d.foot_breadth / 2.0,
        }
    }

    /// Returns the point at these shares of half the breadth (outward) and of the length (from the heel), at a height
    /// in mm
    pub(super) fn at(&self, outward: f64, along: f64, height: f64) -> DVec3 {
        self.heel + self.axes * DVec3::new(outward * self.half_breadth, along * self.length, height)
    }
}

/// Adds the left foot and its mirror image
pub(super) fn add_foot(field: &mut Field, a: &Anatomy) {
    let (d, frame) = (a.dimensions, a.frame);
    let m = frame.permille_mm;
    let plan = FootPlan::new(d, frame);
    let (length, half) = (plan.length, plan.half_breadth);
    let heel = d.heel_breadth / 2.0 / half;
    // Rows: station over foot length, outside and inside over half the breadth, top of the foot in per mille, shift outward.
    let row = |along: f64, outer: f64, inner: f64, top: f64, shift: f64| {
        let section = Section {
            center: DVec2::new(shift * half, 9.0 * m),
            outer: outer * half,
            inner: inner * half,
            front: (top - 9.0) * m,
            back: 14.0 * m,
            square_front: 0.1,
            square_back: 0.5,
        };
        (along * length, section)
    };
    let keys = [
        row(0.10, 0.97 * heel, 0.97 * heel, 30.0, -0.02),
        row(0.22, 0.92 * heel, 0.92 * heel, 42.0, 0.0),
        row(0.36, 0.70, 0.64, 49.0, 0.02),
        row(0.50, 0.84, 0.68, 40.0, 0.02),
        row(0.64, 0.98, 0.92, 27.0, 0.0),
        row(0.74, 0.98, 0.98, 19.0, 0.0),
        row(0.82, 0.90, 0.92, 15.0, 0.0),
    ];
    let tube = Tube::new(plan.heel, plan.axes, &keys, [0.10 * length, 0.06 * length]);
    field.add_pair(Region::Foot, Shape::Tube(tube), 15.0 * m, 1.0);
    // The tendon of the heel
    let tendon = Shape::Cone {
        from: DVec3::new(frame.ankle.x, 58.0 * m, frame.ankle.z - 16.0 * m),
        to: plan.at(0.0, 0.13, 24.0 * m),
        radii: [7.0 * m, 0.8 * d.heel_breadth / 2.0],
    };
    field.add_pair(Region::Foot, tendon, 16.0 * m, 1.0);
    // Toes: across, tip along, radius over half the breadth.
    let toes = [
        (-0.62, 1.0, 0.27),
        (-0.16, 0.985, 0.19),
        (0.18, 0.955, 0.18),
        (0.48, 0.92, 0.17),
        (0.75, 0.875, 0.16),
    ];
    for (across, tip, radius) in toes {
        let r = radius * half;
        let from = plan.at(across * 0.98, 0.74, 1.05 * r);
        let mut to = plan.at(across, tip, 0.9 * r);
        to -= plan.axes.y_axis * r;
        let toe = Shape::Cone {
            from,
            to,
            radii: [1.1 * r, r],
        };
        field.add_pair(Region::Foot, toe, 5.0, 1.0);
    }
    // The two malleoli
    for (outward, height) in [(0.72, 0.0), (-0.70, 5.0)] {
        let center = DVec3::new(
            frame.ankle.x,
            frame.ankle.y + height * m,
            frame.ankle.z - 2.0 * m,
        ) + plan.axes.x_axis * (outward * 0.62 * half);
        field.add_pair(
            Region::Foot,
            Shape::ellipsoid(center, DVec3::new(5.5, 8.5, 8.5) * m),
            6.0 * m,
            1.0,
        );
    }
}
