//! Head and neck.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::field::{Field, Region, Relief};
use super::primitives::{Section, Shape, Tube};
use super::shape::Anatomy;

/// Share of the head's length in front of the ear holes
const FRONT_OF_EAR: f64 = 0.53;

/// One row of the head's table
///
/// Depth below the crown over the distance from crown to ear hole; half breadth over half the head's breadth; front and
/// back from the ear hole over half the head's length; squareness of the front.
type Row = [f64; 5];

const FEMALE: [Row; 9] = [
    [0.60, 0.955, 1.03, 0.88, 0.05],
    [0.74, 0.955, 1.05, 0.92, 0.1],
    [0.88, 0.94, 1.03, 0.91, 0.2],
    [1.00, 0.92, 1.00, 0.85, 0.2],
    [1.14, 0.88, 1.01, 0.70, 0.15],
    [1.30, 0.81, 1.02, 0.45, 0.1],
    [1.46, 0.70, 1.00, 0.15, 0.05],
    [1.58, 0.55, 0.97, -0.10, 0.0],
    [1.66, 0.38, 0.90, -0.30, 0.0],
];

const MALE: [Row; 9] = [
    [0.60, 0.96, 1.07, 0.93, 0.2],
    [0.74, 0.955, 1.11, 0.95, 0.2],
    [0.88, 0.945, 1.06, 0.92, 0.3],
    [1.00, 0.925, 1.02, 0.86, 0.2],
    [1.14, 0.88, 1.02, 0.72, 0.15],
    [1.30, 0.81, 1.02, 0.45, 0.05],
    [1.46, 0.72, 1.02, 0.15, 0.0],
    [1.58, 0.60, 1.00, -0.10, 0.0],
    [1.67, 0.48, 0.95, -0.30, 0.0],
];

/// Adds neck, skull, jaw, nose and ears
pub(super) fn add_head(field: &mut Field, a: &Anatomy) {
    add_neck(field, a);
    let (d, frame) = (a.dimensions, a.frame);
    let half_breadth = d.head_breadth / 2.0;
    let half_length = d.head_length / 2.0;
    let drop = d.crown_to_tragion;
    let crown = frame.tragion.y + drop;
    // Stations run down from the crown.
    let axes = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::Z);
    let origin = DVec3::new(0.0, crown, frame.tragion.z);
    let shift = (FRONT_OF_EAR - 0.5) * 2.0 * half_length;
    let keys: Vec<(f64, Section)> = FEMALE
        .iter()
        .zip(&MALE)
        .map(|(f, m)| {
            let row: Row = std::array::from_fn(|i| a.by_sex(f[i], m[i]));
            let front = row[2] * half_length + shift;
            let back = row[3] * half_length - shift;
            let half = row[1] * half_breadth;
            // The head is widest behind its middle.
            let middle = (front - back) / 2.0 - 0.10 * half_length;
            let section = Section {
                center: DVec2::new(0.0, middle),
                outer: half,
                inner: half,
                front: front - middle,
                back: back + middle,
                square_front: row[4],
                square_back: 0.1,
            };
            (row[0] * drop, section)
        })
        .collect();
    let cap = keys[0].0;
    let tube = Tube::new(origin, axes, &keys, [cap, 0.06 * drop]);
    field.add(Region::Head, Shape::Tube(tube), 0.14 * drop);

    let face = |depth: f64, ahead: f64, x: f64| {
        DVec3::new(
            x * half_breadth,
            crown - depth * drop,
            frame.tragion.z + shift + ahead * half_length,
        )
    };
    let bridge = Shape::Cone {
        from: face(0.93, 0.98, 0.0),
        to: face(1.15, 1.16, 0.0),
        radii: [0.075 * half_length, 0.085 * half_length],
    };
    field.add(Region::Head, bridge, 10.0);
    let tip = Shape::ellipsoid(
        face(1.20, 1.15, 0.0),
        DVec3::new(0.17, 0.10, 0.13) * half_length,
    );
    field.add(Region::Head, tip, 8.0);
    let cheek = Shape::ellipsoid(
        face(1.12, 0.64, 0.47),
        DVec3::new(0.30, 0.30, 0.28) * half_breadth,
    );
    field.add_pair(Region::Head, cheek, 24.0, 4.0);
    let lips = Shape::ellipsoid(
        face(1.41, 0.99, 0.0),
        DVec3::new(0.24, 0.14, 0.085) * half_length,
    );
    field.add(Region::Head, lips, 12.0);
    let chin = Shape::ellipsoid(
        face(1.61, 0.88, 0.0),
        DVec3::new(a.by_sex(0.20, 0.32), 0.14, 0.16) * half_length,
    );
    field.add(Region::Head, chin, 14.0);
    // Brows, and below them the eye sockets
    for (center, radii, height) in [
        (
            face(0.80, 0.98, 0.30),
            [38.0, 17.0, 34.0],
            a.by_sex(1.0, 3.0),
        ),
        (face(0.95, 0.94, 0.42), [25.0, 18.0, 32.0], -5.0),
    ] {
        field.add_relief(Relief {
            region: Region::Head,
            center,
            axes: DMat3::IDENTITY,
            radii: DVec3::from_array(radii) * (half_length / 98.0),
            height: height * half_length / 98.0,
        });
    }
    let ear_axes = DMat3::from_rotation_y(0.38);
    let ear = Shape::Ellipsoid {
        center: face(1.08, -0.08, 0.99),
        axes: ear_axes,
        radii: DVec3::new(9.5, d.ear_length / 2.0, 0.29 * d.ear_length),
    };
    field.add_pair(Region::Head, ear, 9.0, 1.0);
}

/// Returns the lower and upper end of the neck's axis
pub(super) fn neck_axis(a: &Anatomy) -> [DVec3; 2] {
    let (m, frame) = (a.frame.permille_mm, a.frame);
    [
        DVec3::new(
            0.0,
            frame.nape.y - 25.0 * m,
            frame.plumb_z - a.by_sex(7.5, 5.0) * m,
        ),
        DVec3::new(
            0.0,
            frame.tragion.y - 4.0 * m,
            frame.plumb_z + a.by_sex(6.5, 16.5) * m,
        ),
    ]
}

fn add_neck(field: &mut Field, a: &Anatomy) {
    let (d, frame) = (a.dimensions, a.frame);
    let m = frame.permille_mm;
    let radius = d.neck_girth * a.scales.neck / TAU;
    let [from, to] = neck_axis(a);
    let along = (to - from).normalize_or(DVec3::Y);
    let axes = DMat3::from_cols(DVec3::X, along, DVec3::X.cross(along));
    let length = from.distance(to);
    let section = |half: f64, front: f64, back: f64| Section {
        center: DVec2::ZERO,
        outer: half * radius,
        inner: half * radius,
        front: front * radius,
        back: back * radius,
        square_front: 0.0,
        square_back: -0.1,
    };
    let keys = [
        (0.0, section(1.25, 1.0, 1.0)),
        (0.35 * length, section(1.02, 1.02, 0.98)),
        (0.62 * length, section(0.97, 1.0, 1.0)),
        (length, section(1.0, 1.0, 1.05)),
    ];
    let tube = Tube::new(from, axes, &keys, [10.0 * m, 10.0 * m]);
    field.add(Region::Neck, Shape::Tube(tube), 16.0 * m);
}
