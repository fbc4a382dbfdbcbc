//! Trunk: rib cage, belly, pelvis, breasts or chest muscles, seat, and the girdle of the shoulders.

use glam::{DMat3, DVec2, DVec3};

use super::field::{Field, Region, Relief};
use super::primitives::{Curve, Section, Shape, Tube};
use super::shape::Anatomy;

/// One row of a trunk table, in per mille: height, half breadth, front and back from the plumb line through the ankles
type Row = [f64; 4];

/// Rib cage, belly and pelvis of an average woman without breasts and seat
const FEMALE: [Row; 15] = [
    [500.0, 66.0, 50.0, 56.0],
    [515.0, 82.0, 61.0, 60.0],
    [545.0, 98.0, 71.0, 62.0],
    [575.0, 97.0, 74.0, 52.0],
    [602.0, 88.0, 73.0, 42.0],
    [630.0, 79.0, 71.0, 36.0],
    [650.0, 75.0, 70.0, 37.0],
    [675.0, 77.0, 67.0, 41.0],
    [700.0, 81.0, 63.0, 47.0],
    [725.0, 86.0, 60.0, 54.0],
    [750.0, 90.0, 54.0, 61.0],
    [775.0, 91.0, 47.5, 63.0],
    [800.0, 80.0, 42.0, 60.0],
    [820.0, 56.0, 33.0, 52.0],
    [850.0, 34.0, 12.0, 38.0],
];

/// The same for an average man
const MALE: [Row; 15] = [
    [500.0, 64.0, 52.0, 54.0],
    [515.0, 80.0, 63.0, 58.0],
    [545.0, 92.0, 68.5, 58.0],
    [575.0, 91.0, 68.0, 54.0],
    [602.0, 86.0, 67.0, 47.0],
    [630.0, 84.0, 65.5, 44.0],
    [650.0, 83.5, 67.5, 45.0],
    [675.0, 86.0, 70.0, 48.0],
    [700.0, 90.0, 71.0, 54.0],
    [725.0, 95.0, 70.0, 58.0],
    [750.0, 99.0, 66.0, 61.0],
    [775.0, 99.0, 57.0, 62.0],
    [800.0, 87.0, 45.0, 59.0],
    [820.0, 60.0, 30.0, 53.0],
    [850.0, 36.0, 14.0, 40.0],
];

/// Heights of the tables' landmarks, in per mille: crotch, seat, waist, tenth rib, chest, armpit, acromion, nape
const LANDMARKS: [f64; 8] = [481.0, 509.0, 602.0, 643.0, 727.0, 759.0, 820.0, 861.0];

/// Share of additional trunk depth that goes to the front: bellies grow forward
const FRONT_SHARE: f64 = 0.72;

/// Maps the heights of the tables to this person
pub(super) fn heights(a: &Anatomy) -> Curve {
    let d = a.dimensions;
    Curve::new(
        LANDMARKS
            .into_iter()
            .zip([
                d.crotch_height,
                d.buttock_height,
                d.waist_height,
                d.tenth_rib_height,
                d.chest_height,
                d.axilla_height,
                d.acromion_height,
                d.nape_height,
            ])
            .collect(),
    )
}

/// Adds the trunk with its lobes and the shoulder girdle
pub(super) fn add_trunk(field: &mut Field, a: &Anatomy) {
    let (m, d, lean) = (a.frame.permille_mm, a.dimensions, a.lean);
    let height = heights(a);
    let scale = Curve::new(vec![
        (d.buttock_height, a.scales.hip),
        (d.waist_height, a.scales.waist),
        (
            d.tenth_rib_height,
            a.scales.waist.sqrt() * a.scales.chest.sqrt(),
        ),
        (d.chest_height, a.scales.chest),
        (d.acromion_height, a.scales.chest.sqrt()),
        (d.nape_height, 1.0),
    ]);
    let chest_growth = d.chest_girth / lean.chest_girth;
    let breadth = Curve::new(vec![
        (d.buttock_height, d.hip_breadth / lean.hip_breadth),
        (d.waist_height, d.waist_breadth / lean.waist_breadth),
        (d.chest_height, chest_growth),
        (d.acromion_height, chest_growth.sqrt()),
        (d.nape_height, d.neck_girth / lean.neck_girth),
    ]);
    let depth = Curve::new(vec![
        (d.buttock_height, d.buttock_depth / lean.buttock_depth),
        (d.waist_height, d.waist_depth / lean.waist_depth),
        (d.chest_height, d.chest_depth / lean.chest_depth),
        (d.acromion_height, chest_growth.sqrt()),
        (d.nape_height, d.neck_girth / lean.neck_girth),
    ]);

    let keys: Vec<(f64, Section)> = FEMALE
        .iter()
        .zip(&MALE)
        .map(|(f, male)| {
            let row: Row = std::array::from_fn(|i| a.by_sex(f[i], male[i]));
            let y = height.at(row[0]);
            let grow = (depth.at(y) * scale.at(y) - 1.0) * (row[2] + row[3]) * m;
            let front = row[2] * m + FRONT_SHARE * grow;
            let back = row[3] * m + (1.0 - FRONT_SHARE) * grow;
            let half = row[1] * m * breadth.at(y) * scale.at(y);
            let middle = (front - back) / 2.0;
            let section = Section {
                center: DVec2::new(0.0, middle),
                outer: half,
                inner: half,
                front: front - middle,
                back: back + middle,
                square_front: 0.35,
                square_back: 0.45,
            };
            (y, section)
        })
        .collect();
    let plumb = DVec3::new(0.0, 0.0, a.frame.plumb_z);
    let bottom = keys[0].0 - d.crotch_height;
    let tube = Tube::new(
        plumb,
        DMat3::IDENTITY,
        &keys,
        [bottom.max(8.0 * m), 20.0 * m],
    )
    .smoothed(11.0 * m);
    field.add(Region::Trunk, Shape::Tube(tube), 0.0);

    add_seat(field, a);
    add_chest(field, a, chest_growth);
    add_girdle(field, a);
    add_reliefs(field, a);
}

/// Bulges and hollows of the trunk that its sections lack: muscles and bones that stand out or leave furrows
///
/// Most of them appear in no outline, so a fit keeps them unchanged. Modeled on rendered bodies of both sexes.
fn add_reliefs(field: &mut Field, a: &Anatomy) {
    let (m, plumb) = (a.frame.permille_mm, a.frame.plumb_z);
    let height = heights(a);
    let girth = a.dimensions.chest_girth / a.lean.chest_girth;
    // Table: x, y, z, radii, height; all in per mille, y along the trunk's tables, z from the plumb line
    let mut add = |[x, y, z]: [f64; 3], radii: [f64; 3], tilt_degrees: f64, lift: f64| {
        field.add_relief(Relief {
            region: Region::Trunk,
            center: DVec3::new(x * m * girth, height.at(y), plumb + z * m * girth),
            axes: DMat3::from_rotation_z(tilt_degrees.to_radians()),
            radii: DVec3::from_array(radii) * m,
            height: lift * m,
        });
    };
    let by_sex = |female: f64, male: f64| a.by_sex(female, male);
    // Between the shoulder blades, and the furrow of the spine down to the loins
    add(
        [0.0, by_sex(832.0, 820.0), -56.0],
        [by_sex(50.0, 64.0), by_sex(78.0, 104.0), 60.0],
        0.0,
        -by_sex(9.0, 16.5),
    );
    add(
        [0.0, by_sex(704.0, 750.0), -56.0],
        [by_sex(28.0, 38.0), 150.0, 60.0],
        0.0,
        -by_sex(13.0, 6.0),
    );
    // Shoulder blades, below them the muscles along the spine and the broad muscle of the back
    add(
        [66.0, by_sex(760.0, 764.0), -52.0],
        [46.0, 58.0, 60.0],
        0.0,
        by_sex(0.0, 13.0),
    );
    add(
        [44.0, 705.0, -52.0],
        [36.0, 60.0, 60.0],
        0.0,
        by_sex(0.0, 4.0),
    );
    // Over the breastbone, between breasts or chest muscles
    add(
        [0.0, by_sex(732.0, 756.0), 56.0],
        [30.0, by_sex(36.0, 40.0), 50.0],
        0.0,
        -by_sex(6.5, 3.5),
    );
    // Lower border of the ribs
    add(
        [by_sex(28.0, 48.0), by_sex(678.0, 694.0), 66.0],
        [40.0, 32.0, 50.0],
        0.0,
        by_sex(1.5, 5.0),
    );
    // The white line of the belly, and the front of the armpit
    add(
        [0.0, 630.0, 66.0],
        [22.0, 105.0, 50.0],
        0.0,
        -by_sex(0.0, 2.5),
    );
    add(
        [104.0, 758.0, 22.0],
        [28.0, 32.0, 42.0],
        0.0,
        by_sex(0.0, 7.0),
    );
    // Groin: from the hip bone down to the pubis
    add(
        [38.0, 535.0, 64.0],
        [56.0, 28.0, 50.0],
        50.0,
        -by_sex(3.2, 8.5),
    );
    add(
        [by_sex(16.0, 24.0), by_sex(501.0, 490.0), 50.0],
        [34.0, 34.0, 50.0],
        0.0,
        -by_sex(3.4, 7.0),
    );
    // The fold and the cleft of the seat
    add(
        [30.0, by_sex(470.0, 484.0), -46.0],
        [30.0, 28.0, 60.0],
        0.0,
        -by_sex(7.5, 5.0),
    );
    add(
        [0.0, 515.0, -66.0],
        [16.0, 32.0, 50.0],
        0.0,
        -by_sex(3.0, 1.0),
    );
}

fn add_seat(field: &mut Field, a: &Anatomy) {
    let (m, d) = (a.frame.permille_mm, a.dimensions);
    let growth = a.scales.hip * d.buttock_depth / a.lean.buttock_depth;
    let radii = DVec3::new(a.by_sex(46.0, 43.0), a.by_sex(50.0, 49.0), 40.0) * m * growth.sqrt();
    let back = a.by_sex(86.0, 74.0) * m * growth.sqrt();
    let center = DVec3::new(
        a.by_sex(42.0, 40.0) * m * growth.sqrt(),
        d.buttock_height + a.by_sex(5.0, 7.0) * m,
        a.frame.plumb_z - back + radii.z,
    );
    field.add_pair(
        Region::Trunk,
        Shape::ellipsoid(center, radii),
        24.0 * m,
        9.0 * m,
    );
}

fn add_chest(field: &mut Field, a: &Anatomy, growth: f64) {
    let (m, d) = (a.frame.permille_mm, a.dimensions);
    let size = m * a.scales.chest * growth;
    // Breasts shrink to zero from female to male, chest muscles the other way around.
    let bust = 1.0 - a.maleness;
    if bust > 0.0 {
        let radii = DVec3::new(38.0, 36.0, 32.0) * size * (0.62 + 0.38 * bust);
        let front = a.by_sex(84.0, 69.0) * size;
        let center = DVec3::new(
            50.0 * size,
            d.chest_height - 1.0 * m,
            a.frame.plumb_z + front - radii.z,
        );
        // A breast rises gradually out of the chest from above.
        let upper = Shape::Cone {
            from: center + DVec3::new(-4.0, 34.0, -20.0) * size,
            to: center,
            radii: [20.0 * size, 0.82 * radii.z],
        };
        field.add_pair(Region::Trunk, upper, 30.0 * m, 14.0 * m);
        field.add_pair(
            Region::Trunk,
            Shape::ellipsoid(center, radii),
            18.0 * m,
            6.0 * m,
        );
    }
    if a.maleness > 0.0 {
        let radii = DVec3::new(54.0, 40.0, 24.0 * a.maleness.sqrt()) * size;
        let front = (64.0 + 5.0 * a.maleness) * size;
        let center = DVec3::new(
            44.0 * size,
            d.chest_height + 4.0 * m,
            a.frame.plumb_z + front - radii.z,
        );
        field.add_pair(
            Region::Trunk,
            Shape::ellipsoid(center, radii),
            34.0 * m,
            14.0 * m,
        );
    }
}

/// Collarbones, shoulder blades and the muscles from the neck to the shoulders
fn add_girdle(field: &mut Field, a: &Anatomy) {
    let (m, frame) = (a.frame.permille_mm, a.frame);
    let joint = frame.shoulder;
    let thick =
        a.by_sex(0.94, 1.06) * (a.dimensions.upper_arm_girth() / a.lean.upper_arm_girth()).sqrt();
    // Stations run from the middle to the shoulder joint; side is the front of the body, front is up.
    let axes = DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y);
    let origin = DVec3::new(0.0, joint.y, joint.z);
    let section = |lift: f64, up: f64, down: f64, front: f64, back: f64| Section {
        center: DVec2::new(-8.0 * m, lift * m),
        outer: front * m * thick,
        inner: back * m * thick,
        front: up * m * thick,
        back: down * m * thick,
        square_front: 0.0,
        square_back: 0.0,
    };
    let keys = [
        (0.0, section(4.0, 22.0, 30.0, a.by_sex(40.0, 33.0), 38.0)),
        (
            0.45 * joint.x,
            section(4.0, 24.0, 30.0, a.by_sex(38.0, 34.0), 38.0),
        ),
        (
            0.8 * joint.x,
            section(3.0, 24.0, 30.0, a.by_sex(31.0, 38.0), 35.0),
        ),
        (
            joint.x,
            section(0.0, 22.0, 26.0, a.by_sex(27.0, 34.0), 28.0),
        ),
    ];
    let tube = Tube::new(origin, axes, &keys, [10.0 * m, 20.0 * m]);
    field.add(Region::Trunk, Shape::Tube(tube), 42.0 * m);

    // The broad muscle of the back, from the ribs up to the arm: the rear fold of the armpit.
    let ribs = DVec3::new(
        a.by_sex(60.0, 67.0) * m,
        a.dimensions.chest_height - 20.0 * m,
        frame.plumb_z - 22.0 * m,
    );
    let insertion =
        frame.shoulder + frame.upper_arm_axes * DVec3::new(a.by_sex(-12.0, -9.0), 24.0, -8.0) * m;
    let latissimus = Shape::Cone {
        from: ribs,
        to: insertion,
        radii: [a.by_sex(12.0, 11.0) * m * thick, 9.0 * m * thick],
    };
    field.add_pair(Region::Trunk, latissimus, 34.0 * m, 1.0);

    // The chest muscle from the upper ribs to the arm: the front fold of the armpit.
    let ribs = DVec3::new(
        a.by_sex(56.0, 62.0) * m,
        a.dimensions.axilla_height + a.by_sex(16.0, 10.0) * m,
        frame.plumb_z + a.by_sex(14.0, 32.0) * m,
    );
    let insertion = frame.shoulder
        + frame.upper_arm_axes * DVec3::new(a.by_sex(-4.0, -9.0), 36.0, a.by_sex(9.0, 14.0)) * m;
    let pectoral = Shape::Cone {
        from: ribs,
        to: insertion,
        radii: [
            a.by_sex(12.0, 18.0) * m * thick,
            a.by_sex(11.0, 15.0) * m * thick,
        ],
    };
    field.add_pair(Region::Trunk, pectoral, 34.0 * m, 1.0);

    let neck = DVec3::new(18.0 * m, frame.nape.y - 4.0 * m, frame.plumb_z - 14.0 * m);
    let acromion = DVec3::new(joint.x - 10.0 * m, joint.y + 9.0 * m, joint.z - 7.0 * m);
    let trapezius = Shape::Cone {
        from: neck,
        to: acromion,
        radii: [12.0 * m * thick, 13.0 * m * thick],
    };
    field.add_pair(Region::Trunk, trapezius, 26.0 * m, 10.0 * m);
}
