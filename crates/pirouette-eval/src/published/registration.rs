//! Table 2: automated registration at eight turn angles, and its time.

use std::time::Instant;

use glam::{DVec2, DVec3};
use pirouette::normalize::register::{ReferenceContourMap, register};
use pirouette::normalize::{RegisterOptions, shared_skeleton_joints};
use pirouette::pipeline::CancelToken;
use pirouette_body::mannequin::{DEFAULT_BMI, MannequinParameters, mannequin};
use pirouette_body::render::silhouette;
use pirouette_body::{Avatar, Bone, Pose, Sex, TurnAngle};
use pirouette_geom::chain::RigidMotion;
use pirouette_geom::contour::trace_outline;
use pirouette_geom::coverage::fill_polygons;
use pirouette_geom::distance_map::distance_to;
use pirouette_geom::{Grid, Mask};
use pirouette_synthetic::Random;
use serde_json::{Value, json};

use super::exhaustive::{self, Found};
use super::picture::{difference, side_by_side};
use super::{Effort, Experiment, Figure, Picture, camera_of};
use crate::people::Person;
use crate::table::{Cell, Table, mean, percentile};
use crate::{OnStep, StudyError, do_all};

/// Turn angles, in degrees
const ANGLES: [u16; 8] = [0, 45, 90, 135, 180, 225, 270, 315];

/// Largest shift of silhouettes in x and in y, in px
const SHIFT_PX: f64 = 20.0;

/// Largest rotation of silhouettes, in degrees
const TURN_DEGREES: f64 = 5.0;

/// Standard deviation of the bend of each arm joint of people with sway, in degrees
const ARM_DEGREES: f64 = 3.0;

/// Standard deviation of the bend of each leg joint, in degrees
const LEG_DEGREES: f64 = 0.5;

/// The time of a registration is the minimum of this number of runs, since other programs use the machine, too
const TIMED_RUNS: usize = 3;

/// Difference of the body mass index of another build
const OTHER_BMI: f64 = 6.0;

/// Distance of the contour points, in px, as in the method
const SPACING_PX: f64 = 2.0;

/// Optima with a smaller difference are equal, in px of mean distance
const SAME_OPTIMUM_PX: f64 = 1e-3;

const SEED: u64 = 0x7e91_0002;

/// Conditions with pictures
const SHOWN: [Condition; 3] = [Condition::Same, Condition::OtherSex, Condition::OtherBuild];

/// Registered silhouette and reference
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Condition {
    /// A person to the same person
    Same,
    /// ... with arms and legs moved slightly
    Bent,
    /// A mannequin to one of the other sex
    OtherSex,
    /// A mannequin to one of another build
    OtherBuild,
    /// A person to the neutral mannequin of the same stature
    Stranger,
}

impl Condition {
    const ALL: [Condition; 5] = [
        Condition::Same,
        Condition::Bent,
        Condition::OtherSex,
        Condition::OtherBuild,
        Condition::Stranger,
    ];

    fn name(self) -> &'static str {
        match self {
            Condition::Same => "the same figure",
            Condition::Bent => "the same, limbs swayed",
            Condition::OtherSex => "the other sex",
            Condition::OtherBuild => "another build",
            Condition::Stranger => "person to mannequin",
        }
    }

    /// Returns the registered avatar and the reference
    fn avatars(self, person: &Person) -> Option<(Avatar, Avatar)> {
        let stature_mm = person.avatar.stature_mm();
        let avatar = |sex, bmi: f64| {
            let made = mannequin(&MannequinParameters {
                sex,
                stature_mm: Some(stature_mm),
                mass_kg: Some(bmi * (stature_mm / 1000.0).powi(2)),
                ..MannequinParameters::default()
            });
            made.ok()
        };
        let own = || person.avatar.clone();
        match self {
            Condition::Same | Condition::Bent => Some((own(), own())),
            Condition::OtherSex => {
                let other = match person.sex {
                    Sex::Female => Sex::Male,
                    _ => Sex::Female,
                };
                Some((avatar(person.sex, person.bmi)?, avatar(other, person.bmi)?))
            }
            Condition::OtherBuild => {
                let heavier = person.bmi < 27.0;
                let bmi = person.bmi + if heavier { OTHER_BMI } else { -OTHER_BMI };
                Some((avatar(person.sex, person.bmi)?, avatar(person.sex, bmi)?))
            }
            Condition::Stranger => Some((own(), avatar(Sex::Neutral, DEFAULT_BMI)?)),
        }
    }
}

/// Result of one registration method
#[derive(Debug, Clone, Copy, PartialEq)]
struct Outcome {
    /// Mean distance of the contour points from their true positions, in px
    error_px: f64,
    /// Mean distance to the reference contour, in px
    fitness_px: f64,
    milliseconds: f64,
}

/// One registration
struct Trial {
    condition: Condition,
    degrees: u16,
    person: u64,
    before_px: f64,
    ours: Outcome,
    /// Error including the arms
    arms_error_px: f64,
    /// The published search with the fine map, and with a map of integer pixels
    published: Option<[Outcome; 2]>,
    map_milliseconds: f64,
    /// Error of the contour's centroid in x and in y, in px
    off: DVec2,
    picture: Option<Picture>,
}

/// Moves silhouettes by known motions of the plane and registers them to the unmoved reference
///
/// # Errors
/// When cancelled.
pub(super) fn run(
    people: &[Person],
    effort: Effort,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<Experiment, StudyError> {
    let people = &people[..people.len().min(effort.pick(4, 20))];
    // The slow published search runs for every n-th person only.
    let twin_every = effort.pick(4, 2);
    let jobs: Vec<(&Person, Condition, bool)> = people
        .iter()
        .enumerate()
        .flat_map(|(index, person)| {
            Condition::ALL.map(|condition| {
                let twin = index % twin_every == 0 && condition == Condition::Same;
                (person, condition, twin)
            })
        })
        .collect();
    let trials = do_all(&jobs, cancel, on_step, |&(person, condition, twin)| {
        let trials = register_person(person, condition, twin);
        let errors: Vec<f64> = trials.iter().map(|trial| trial.ours.error_px).collect();
        let error = mean(&errors).unwrap_or(f64::NAN);
        let text = format!("registered to {}: {error:.2} px", condition.name());
        (trials, text)
    })?;
    let trials: Vec<Trial> = trials.into_iter().flatten().collect();
    let of = |condition: Condition| {
        let trials = trials.iter();
        trials.filter(move |trial| trial.condition == condition)
    };
    let errors = |condition: Condition| -> Vec<f64> {
        of(condition).map(|trial| trial.ours.error_px).collect()
    };
    let mean_of = |values: &[f64]| mean(values).unwrap_or(f64::NAN);
    let same = errors(Condition::Same);
    let compared: Vec<(Outcome, [Outcome; 2])> = trials
        .iter()
        .filter_map(|trial| Some((trial.ours, trial.published?)))
        .collect();
    let no_worse = compared
        .iter()
        .filter(|(ours, [fine, _])| ours.fitness_px <= fine.fitness_px + SAME_OPTIMUM_PX)
        .count();
    let times: Vec<f64> = trials.iter().map(|t| t.ours.milliseconds).collect();
    let time = percentile(&times, 0.5).unwrap_or(f64::NAN);
    Ok(Experiment {
        name: "registration",
        title: "Table 2: automated registration",
        reading: vec![
            "Each person stands in the reference pose at eight turn angles. The silhouette is moved by a known random \
             motion (up to 20 px in x and in y, up to 5 degrees), drawn as a mask, traced, and registered to the \
             unmoved reference silhouette. The error is the mean distance of the contour points from their true \
             positions, which includes the remaining rotation.",
            "For two of the published errors of manual registration, the length is inconsistent with the listed components in x and \
             in y. Ours are lengths of vectors; the components in x and y are those of the contour's centroid, and the JSON output \
             contains all of them.",
            "For the other sex and another build, both avatars are mannequins in the same pose and of the same stature, as \
             the published ones are from one modeler: the person's sex and body mass index against the other sex, or against \
             an index that differs by 6. The true position is the same spot on the floor: no motion makes the \
             silhouettes equal. The last row is harder: a person with an individual shape and posture, as given by the previous \
             steps, against the neutral mannequin; most of its error is posture, and no motion of the \
             plane corrects it. We interpret the published \"4.5 / 12.5 px\" as the means for the other sex and for another build.",
            "Arms are ignored in the registration, since people hold them differently and the refinement bends them \
             anyway; one column contains the error with arms.",
            "Of the published search, the paper states 10 rounds of 11 x 11 x 11 candidates whose steps shrink by 0.9, but not the \
             first steps (here 0.5 degrees and 1 px). It runs in the same process on the same contours, including the arms; the \
             optima are compared by the published fitness, the mean distance of all contour points. Neither time \
             contains the distance map, which is computed once for each reference.",
        ],
        figures: vec![
            (Figure::RegistrationMean, mean_of(&same)),
            (
                Figure::RegistrationWorst,
                same.iter().copied().fold(f64::NAN, f64::max),
            ),
            (
                Figure::RegistrationOtherSex,
                mean_of(&errors(Condition::OtherSex)),
            ),
            (
                Figure::RegistrationOtherBuild,
                mean_of(&errors(Condition::OtherBuild)),
            ),
            (Figure::RegistrationTime, time),
            (
                Figure::RegistrationOptimum,
                100.0 * no_worse as f64 / compared.len() as f64,
            ),
        ],
        tables: vec![
            by_condition(&trials),
            by_angle(&trials),
            by_search(&trials, &compared),
        ],
        values: trials.iter().map(Trial::to_json).collect(),
        pictures: trials.into_iter().filter_map(|t| t.picture).collect(),
    })
}

fn by_condition(trials: &[Trial]) -> Table {
    let mut table = Table::new(
        "Error in px by what the silhouette is registered to",
        &[
            "reference",
            "trials",
            "unregistered",
            "mean, arms counted",
            "mean",
            "median",
            "worst",
            "x",
            "y",
        ],
    );
    for condition in Condition::ALL {
        let of = || trials.iter().filter(|t| t.condition == condition);
        let errors: Vec<f64> = of().map(|t| t.ours.error_px).collect();
        let before: Vec<f64> = of().map(|t| t.before_px).collect();
        let with_arms: Vec<f64> = of().map(|t| t.arms_error_px).collect();
        let off =
            |axis: fn(DVec2) -> f64| mean(&of().map(|t| axis(t.off).abs()).collect::<Vec<_>>());
        table.rows.push(vec![
            Cell::Text(condition.name().into()),
            Cell::Number(errors.len() as f64, 0),
            Cell::number(mean(&before), 2),
            Cell::number(mean(&with_arms), 3),
            Cell::number(mean(&errors), 3),
            Cell::number(percentile(&errors, 0.5), 3),
            Cell::number(percentile(&errors, 1.0), 3),
            Cell::number(off(|d| d.x), 3),
            Cell::number(off(|d| d.y), 3),
        ]);
    }
    table
}

fn by_angle(trials: &[Trial]) -> Table {
    let mut heads = vec!["turn"];
    heads.extend(Condition::ALL.map(Condition::name));
    let mut table = Table::new("Mean error in px by turn angle", &heads);
    for degrees in ANGLES {
        let mut row = vec![Cell::Text(format!("{degrees}°"))];
        row.extend(Condition::ALL.map(|condition| {
            let of = trials.iter();
            let of = of.filter(|t| t.condition == condition && t.degrees == degrees);
            let errors: Vec<f64> = of.map(|t| t.ours.error_px).collect();
            Cell::number(mean(&errors), 3)
        }));
        table.rows.push(row);
    }
    table
}

fn by_search(trials: &[Trial], compared: &[(Outcome, [Outcome; 2])]) -> Table {
    let mut table = Table::new(
        format!(
            "Ours and the published search, {} registrations to the same figure",
            compared.len()
        ),
        &[
            "search",
            "mean error px",
            "worst px",
            "mean distance px",
            "median ms",
            "times slower",
        ],
    );
    let ours: Vec<Outcome> = compared.iter().map(|(ours, _)| *ours).collect();
    let time = |outcomes: &[Outcome]| {
        percentile(
            &outcomes.iter().map(|o| o.milliseconds).collect::<Vec<_>>(),
            0.5,
        )
    };
    let fast = time(&ours);
    let mut add = |name: &str, outcomes: &[Outcome]| {
        let errors: Vec<f64> = outcomes.iter().map(|o| o.error_px).collect();
        let fitness: Vec<f64> = outcomes.iter().map(|o| o.fitness_px).collect();
        let slow = time(outcomes);
        let ratio = slow.zip(fast).map(|(slow, fast)| slow / fast);
        table.rows.push(vec![
            Cell::Text(name.into()),
            Cell::number(mean(&errors), 3),
            Cell::number(percentile(&errors, 1.0), 3),
            Cell::number(mean(&fitness), 4),
            Cell::number(slow, 2),
            Cell::number(ratio, 0),
        ]);
    };
    add("descent on the map (ours)", &ours);
    let fine: Vec<Outcome> = compared.iter().map(|(_, [fine, _])| *fine).collect();
    add("exhaustive, same map", &fine);
    let coarse: Vec<Outcome> = compared.iter().map(|(_, [_, coarse])| *coarse).collect();
    add("exhaustive, map of integer pixels", &coarse);
    let maps: Vec<f64> = trials.iter().map(|t| t.map_milliseconds).collect();
    if let Some(map) = percentile(&maps, 0.5) {
        let note =
            format!("Computation of the map, once for each reference: {map:.1} ms (median).");
        table.notes.push(note);
    }
    table
}

impl Trial {
    fn to_json(&self) -> Value {
        let rounded = |value: f64| (value * 1e4).round() / 1e4;
        json!({
            "reference": self.condition.name(),
            "turn_deg": self.degrees,
            "person": self.person,
            "unregistered_px": rounded(self.before_px),
            "error_px": rounded(self.ours.error_px),
            "off_x_px": rounded(self.off.x),
            "off_y_px": rounded(self.off.y),
        })
    }
}

/// Registers one person at all turn angles
fn register_person(person: &Person, condition: Condition, twin: bool) -> Vec<Trial> {
    let Some(avatars) = condition.avatars(person) else {
        return Vec::new();
    };
    let angles = ANGLES.iter();
    angles
        .map(|&degrees| register_once(person.seed, condition, &avatars, degrees, twin))
        .collect()
}

fn register_once(
    seed: u64,
    condition: Condition,
    (avatar, reference): &(Avatar, Avatar),
    degrees: u16,
    twin: bool,
) -> Trial {
    let mix = (seed << 16) ^ u64::from(degrees);
    let mut random = Random::new(SEED ^ mix.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let moved = RigidMotion::about(
        DVec2::new(400.0, 500.0),
        random.between(-TURN_DEGREES, TURN_DEGREES).to_radians(),
        DVec2::new(
            random.between(-SHIFT_PX, SHIFT_PX),
            random.between(-SHIFT_PX, SHIFT_PX),
        ),
    );
    let mut pose = Pose::default();
    if condition == Condition::Bent {
        use Bone::*;
        for (bone, degrees) in [
            (LeftUpperArm, ARM_DEGREES),
            (LeftForearm, ARM_DEGREES),
            (RightUpperArm, ARM_DEGREES),
            (RightForearm, ARM_DEGREES),
            (LeftThigh, LEG_DEGREES),
            (RightThigh, LEG_DEGREES),
        ] {
            let mut bend = || random.normal().clamp(-2.0, 2.0) * degrees.to_radians();
            pose.rotations[bone] = DVec3::new(bend(), 0.0, bend());
        }
    }
    let camera = camera_of(avatar.stature_mm());
    let turn = TurnAngle::from_degrees(f64::from(degrees));
    let joints = shared_skeleton_joints(avatar, &pose, turn, &camera).photo;
    let joints = joints.map(|p| Some(moved.apply(p)));
    let coverage = |avatar: &Avatar, pose: &Pose| -> Grid<f32> {
        let positions = avatar.posed(pose, turn).positions;
        silhouette(&positions, &avatar.mesh.triangles, &camera)
    };
    let target = coverage(reference, &Pose::default());
    let mask = drawn_moved(&coverage(avatar, &pose), &moved);
    let contour: Vec<DVec2> = trace_outline(&mask.map(|&m| f32::from(u8::from(m))), 0.5)
        .iter()
        .flat_map(|contour| contour.resample(SPACING_PX).points)
        .collect();
    let back = moved.inverse();
    let centroid = contour.iter().sum::<DVec2>() / contour.len().max(1) as f64;
    let error = |found: &RigidMotion| {
        let points = contour.iter();
        let off = points.map(|&p| found.apply(p).distance(back.apply(p)));
        off.sum::<f64>() / contour.len().max(1) as f64
    };
    let start = Instant::now();
    let map = ReferenceContourMap::from_coverage(&target);
    let map_milliseconds = 1e3 * start.elapsed().as_secs_f64();
    let mut milliseconds = f64::INFINITY;
    let mut found = None;
    for _ in 0..TIMED_RUNS {
        let start = Instant::now();
        found = Some(register(
            &contour,
            &joints,
            &map,
            &RegisterOptions::default(),
        ));
        milliseconds = milliseconds.min(1e3 * start.elapsed().as_secs_f64());
    }
    let found = found.expect("there is at least one run");
    let with_arms = RegisterOptions {
        arms: true,
        ..RegisterOptions::default()
    };
    let with_arms = register(&contour, &joints, &map, &with_arms);
    let ours = Outcome {
        milliseconds,
        error_px: error(&found.motion()),
        fitness_px: with_arms.mean_distance_after_px,
    };
    let published = twin.then(|| {
        let timed = |search: &dyn Fn() -> Found| {
            let start = Instant::now();
            let found = search();
            Outcome {
                milliseconds: 1e3 * start.elapsed().as_secs_f64(),
                error_px: error(&found.motion),
                fitness_px: found.mean_distance_px,
            }
        };
        let pixels = distance_to(&border(&target.threshold(0.5)));
        let coarse = |p: DVec2| {
            let x = (p.x.max(0.0) as usize).min(pixels.width() - 1);
            let y = (p.y.max(0.0) as usize).min(pixels.height() - 1);
            f64::from(pixels[(x, y)])
        };
        [
            timed(&|| exhaustive::search(&contour, |p| map.distance_px(p))),
            timed(&|| exhaustive::search(&contour, coarse)),
        ]
    });
    let registered = || drawn_moved(&mask.map(|&m| f32::from(u8::from(m))), &found.motion());
    let shown = seed == 1 && [0, 90].contains(&degrees) && SHOWN.contains(&condition);
    let picture = shown.then(|| Picture {
        name: match (condition, degrees) {
            (Condition::Same, 0) => "registration-same-000",
            (Condition::Same, _) => "registration-same-090",
            (Condition::OtherSex, 0) => "registration-sex-000",
            (Condition::OtherSex, _) => "registration-sex-090",
            (_, 0) => "registration-build-000",
            _ => "registration-build-090",
        },
        caption: format!(
            "Registered to {} at {degrees}°: before and after, over the reference",
            condition.name()
        ),
        photo: side_by_side(&[
            &difference(&mask, &target.threshold(0.5)),
            &difference(&registered(), &target.threshold(0.5)),
        ]),
    });
    Trial {
        condition,
        degrees,
        person: seed,
        before_px: error(&RigidMotion::IDENTITY),
        ours,
        arms_error_px: error(&with_arms.motion()),
        published,
        map_milliseconds,
        off: found.apply(centroid) - back.apply(centroid),
        picture,
    }
}

/// Draws a silhouette, transformed by a motion of the plane, as a mask
fn drawn_moved(coverage: &Grid<f32>, motion: &RigidMotion) -> Mask {
    let polygons: Vec<Vec<DVec2>> = trace_outline(coverage, 0.5)
        .into_iter()
        .map(|contour| contour.points.iter().map(|&p| motion.apply(p)).collect())
        .collect();
    fill_polygons(coverage.width(), coverage.height(), &polygons).threshold(0.5)
}

/// Returns the pixels of a mask that are adjacent to the outside
fn border(mask: &Mask) -> Mask {
    Mask::from_fn(mask.width(), mask.height(), |x, y| {
        let (x, y) = (x as isize, y as isize);
        let inside = |dx: isize, dy: isize| mask.get(x + dx, y + dy).is_some_and(|&m| m);
        let all = inside(1, 0) && inside(-1, 0) && inside(0, 1) && inside(0, -1);
        inside(0, 0) && !all
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_are_pixels_adjacent_to_the_outside() {
        let mask = Mask::from_art("##### ##### #####");
        assert_eq!(border(&mask).to_art(), "#####\n#...#\n#####\n");
    }

    #[test]
    fn a_moved_silhouette_is_registered_at_least_as_accurately_as_by_the_slow_search() {
        let person = Person::new(2).unwrap();
        let avatars = Condition::Same.avatars(&person).unwrap();
        let trial = register_once(2, Condition::Same, &avatars, 45, true);
        let [fine, coarse] = trial.published.unwrap();
        assert!(trial.before_px > 2.0);
        assert!(trial.ours.error_px < 0.2, "{:?}", trial.ours);
        assert!(trial.ours.fitness_px <= fine.fitness_px + SAME_OPTIMUM_PX);
        assert!(fine.error_px < 3.0 && coarse.error_px < 5.0);
    }
}
