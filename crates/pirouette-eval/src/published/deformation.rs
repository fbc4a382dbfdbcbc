//! Table 1: arm joints moved by up to 50 px, and back, by the deformation.

use glam::DVec2;
use pirouette::normalize::deform::{
    ContourSource, DeformError, DeformOptions, DeformableSilhouette, fill_contours, handles,
    trace_silhouette,
};
use pirouette::normalize::{JointPositions, NormalizeMethod, ReferenceView};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Joint, TurnAngle};
use pirouette_geom::morphology::dilate;
use pirouette_geom::{Grid, Mask, Windowed};
use pirouette_synthetic::Random;
use serde_json::json;

use super::picture::{difference, side_by_side};
use super::{Effort, Experiment, Figure, Picture, camera_of};
use crate::people::Person;
use crate::table::{Cell, Table, mean};
use crate::{OnStep, StudyError, do_all};
use pirouette::pipeline::CancelToken;

/// Largest distance by which joints are moved, in px
const REACH_PX: f64 = 50.0;

/// Joints that are moved, independently of each other
const MOVED: [Joint; 4] = [
    Joint::LeftElbow,
    Joint::LeftWrist,
    Joint::RightElbow,
    Joint::RightWrist,
];

/// Distance up to which borders count as equal in the published figures, in px
const ALLOWANCE_PX: f64 = 2.0;

/// Seeds of the trials
const SEED: u64 = 0xa1a9_0001;

/// A variant of the deformation
struct Variant {
    name: &'static str,
    options: DeformOptions,
    /// Whether the intermediate silhouette has soft borders
    soft: bool,
}

impl Variant {
    fn all() -> Vec<Variant> {
        let usual = DeformOptions::default();
        let variant = |name, options| Variant {
            name,
            options,
            soft: true,
        };
        let mut one_round = usual;
        one_round.arap.rounds = 1;
        vec![
            variant("nothing", usual),
            Variant {
                soft: false,
                ..variant("soft border between the steps", usual)
            },
            Variant {
                soft: false,
                ..variant(
                    "outline between the pixels: border pixels",
                    DeformOptions {
                        contour: ContourSource::BorderPixels,
                        ..usual
                    },
                )
            },
            variant(
                "fine contour: tolerance of 4 px",
                DeformOptions {
                    tolerance_px: 4.0,
                    ..usual
                },
            ),
            variant(
                "fine mesh: 8 times larger triangles",
                DeformOptions {
                    max_triangle_area: 8.0 * usual.max_triangle_area,
                    ..usual
                },
            ),
            variant("29 of 30 rounds", one_round),
        ]
    }
}

/// One trial: the Dice indices of each variant, without and with the allowance
struct Trial {
    person: u64,
    farthest_px: f64,
    dice: Vec<Option<(f64, f64)>>,
}

/// Moves elbows and wrists of silhouettes seen from the front, and back
///
/// Both elbows and both wrists are moved to random positions within 50 px; the deformed silhouette is rasterized,
/// traced and meshed again, and its joints are moved back. The resulting mask is compared with the original one by the
/// Dice index `2 |A and B| / (|A| + |B|)`.
///
/// # Errors
/// When cancelled.
pub(super) fn run(
    people: &[Person],
    effort: Effort,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<Experiment, StudyError> {
    let variants = Variant::all();
    let count = effort.pick(20, 100);
    let jobs: Vec<(u64, &Person)> = (0..count).zip(people.iter().cycle()).collect();
    let trials = do_all(&jobs, cancel, on_step, |&(number, person)| {
        let trial = try_once(number, person, &variants);
        let dice = trial.dice.first().copied().flatten();
        let text = dice.map_or("failed".into(), |(d, _)| format!("Dice {:.2} %", 100.0 * d));
        (trial, format!("arms moved forward and back: {text}"))
    })?;
    let mut table = Table::new(
        format!(
            "{} trials, one part of the deformation disabled",
            trials.len()
        ),
        &["left out", "mean %", "worst %", "mean % with 2 px allowed"],
    );
    let mut found = Vec::new();
    for (index, variant) in variants.iter().enumerate() {
        // A failed trial has a Dice index of 0.
        let all: Vec<(f64, f64)> = trials
            .iter()
            .map(|trial| trial.dice[index].unwrap_or((0.0, 0.0)))
            .collect();
        let exact: Vec<f64> = all.iter().map(|(dice, _)| 100.0 * dice).collect();
        let allowed: Vec<f64> = all.iter().map(|(_, dice)| 100.0 * dice).collect();
        let worst = exact.iter().copied().fold(f64::INFINITY, f64::min);
        if index == 0 {
            found.push((Figure::DeformationMean, mean(&exact).unwrap_or(f64::NAN)));
            found.push((Figure::DeformationWorst, worst));
        }
        table.rows.push(vec![
            Cell::Text(variant.name.into()),
            Cell::number(mean(&exact), 2),
            Cell::Number(worst, 2),
            Cell::number(mean(&allowed), 2),
        ]);
    }
    let own = |trial: &Trial| trial.dice[0].map_or(0.0, |(dice, _)| dice);
    let worst = (0..trials.len()).min_by(|&a, &b| own(&trials[a]).total_cmp(&own(&trials[b])));
    let pictures = worst.and_then(|worst| {
        let (number, person) = jobs[worst];
        scene(number, person).picture(worst)
    });
    let rounded = |value: f64| (value * 1e5).round() / 1e5;
    let values = trials.iter().map(|trial| {
        json!({
            "person": trial.person,
            "farthest_px": rounded(trial.farthest_px),
            "dice": trial.dice.first().copied().flatten().map(|d| rounded(d.0)),
        })
    });
    Ok(Experiment {
        name: "deformation",
        title: "Table 1: deformation, forward and back",
        reading: vec![
            "Both elbows and both wrists of a silhouette seen from the front are moved to random positions, uniformly distributed \
             in a disk with a radius of 50 px around the original ones, at a stature of 830 px. The lengths of upper arms and \
             forearms change, which is harder than the deformations of the method itself. The result is rasterized, traced and \
             meshed again, and the \
             joints are moved back.",
            "The resulting mask is compared with the original one. The published Dice indices tolerate borders \
             that differ by up to 2 px; ours do not, but the last column does.",
        ],
        figures: found,
        values: values.collect(),
        pictures: pictures.into_iter().collect(),
        tables: vec![table],
    })
}

/// A silhouette, and the target positions of its joints
struct Scene {
    seen: ReferenceView,
    moved: JointPositions,
    farthest_px: f64,
}

fn scene(number: u64, person: &Person) -> Scene {
    let camera = camera_of(person.avatar.stature_mm());
    let avatar = &person.avatar;
    let seen = ReferenceView::render(
        avatar,
        &SilhouetteMesh::new(&avatar.mesh.triangles),
        TurnAngle::default(),
        &camera,
        NormalizeMethod::default(),
    );
    let mut random = Random::new(SEED ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let rest = seen.joints.map(Some);
    let mut moved = rest;
    let mut farthest_px = 0.0;
    for joint in MOVED {
        let shift = DVec2::from_angle(random.between(0.0, std::f64::consts::TAU))
            * REACH_PX
            * random.uniform().sqrt();
        farthest_px = f64::max(farthest_px, shift.length());
        moved[joint] = rest[joint].map(|p| p + shift);
    }
    Scene {
        seen,
        moved,
        farthest_px,
    }
}

impl Scene {
    /// Returns the silhouette with its arm joints moved, and moved back
    fn there_and_back(&self, variant: &Variant) -> Option<[Mask; 2]> {
        let rest = self.seen.joints.map(Some);
        let there = carried(&self.seen.coverage, &rest, &self.moved, variant).ok()?;
        let back = carried(&there, &self.moved, &rest, variant).ok()?;
        Some([there.threshold(0.5), back.threshold(0.5)])
    }

    fn picture(&self, number: usize) -> Option<Picture> {
        let before = self.seen.coverage.threshold(0.5);
        let [there, back] = self.there_and_back(&Variant::all()[0])?;
        Some(Picture {
            name: "deformation",
            caption: format!(
                "The worst trial (number {number}): original, with the arm joints moved, and moved back over the original"
            ),
            photo: side_by_side(&[
                &difference(&before, &before),
                &difference(&there, &there),
                &difference(&back, &before),
            ]),
        })
    }
}

fn try_once(number: u64, person: &Person, variants: &[Variant]) -> Trial {
    let scene = scene(number, person);
    let before = scene.seen.coverage.threshold(0.5);
    let dice = variants
        .iter()
        .map(|variant| {
            let [_, after] = scene.there_and_back(variant)?;
            Some((
                dice(&before, &after, 0.0),
                dice(&before, &after, ALLOWANCE_PX),
            ))
        })
        .collect();
    Trial {
        person: person.seed,
        farthest_px: scene.farthest_px,
        dice,
    }
}

/// Deforms a silhouette to follow its joints
fn carried(
    coverage: &Grid<f32>,
    from: &JointPositions,
    to: &JointPositions,
    variant: &Variant,
) -> Result<Grid<f32>, DeformError> {
    let mask = coverage.threshold(0.5);
    let soft = if variant.soft {
        Windowed::new(coverage)
    } else {
        Windowed::new(&mask.map(|&inside| f32::from(u8::from(inside))))
    };
    let contours = trace_silhouette(&mask, &soft, variant.options.contour);
    let handles = handles(from, to, |_| true);
    let silhouette = DeformableSilhouette::new(&contours, &handles.sources, &variant.options)?;
    let deformed = silhouette.deform(&handles.targets);
    Ok(fill_contours(
        mask.width(),
        mask.height(),
        &deformed.contours,
    ))
}

/// Computes the Dice index of two masks; pixels within `allowance_px` of the other mask count as common
fn dice(a: &Mask, b: &Mask, allowance_px: f64) -> f64 {
    let common = |a: &Mask, b: &Mask| {
        let near = if allowance_px > 0.0 {
            dilate(b, allowance_px)
        } else {
            b.clone()
        };
        let pairs = a.as_slice().iter().zip(near.as_slice());
        pairs.filter(|(a, b)| **a && **b).count()
    };
    let all = a.area() + b.area();
    if all == 0 {
        return 1.0;
    }
    (common(a, b) + common(b, a)) as f64 / all as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dice_counts_common_pixels_twice_and_tolerates_near_ones() {
        let (a, b) = (
            Mask::from_art("####.. ####.."),
            Mask::from_art(".####. .####."),
        );
        assert_eq!(dice(&a, &b, 0.0), 0.75);
        assert_eq!(dice(&a, &b, 1.0), 1.0);
        assert_eq!(dice(&a, &a, 0.0), 1.0);
        assert_eq!(dice(&a, &Mask::filled(6, 2, false), 0.0), 0.0);
    }

    #[test]
    fn arms_return_and_every_disabled_part_has_an_effect() {
        let person = Person::new(3).unwrap();
        let variants = Variant::all();
        let trial = try_once(0, &person, &variants);
        assert!(trial.farthest_px <= REACH_PX);
        assert!(scene(0, &person).picture(0).is_some());
        let (complete, _) = trial.dice[0].unwrap();
        assert!(complete > 0.99, "{complete}");
        for (variant, dice) in variants.iter().zip(&trial.dice).skip(1) {
            let (dice, allowed) = dice.unwrap();
            assert!(dice != complete && dice > 0.9, "{}: {dice}", variant.name);
            assert!(allowed >= dice);
        }
    }
}
