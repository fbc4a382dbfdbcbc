//! 3D reconstruction: effect of each step.

use pirouette::carve::{CarveOptions, CarveView, carve};
use pirouette::measure::{Measure, measure_avatar};
use pirouette::normalize::{NormalizeMethod, NormalizeOptions, RefineOptions, RegisterOptions};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, Normalizer, Report, run as run_job};
use pirouette::skeleton_fit::Skeleton;
use pirouette::view::SolvedView;
use pirouette_body::render::silhouette;
use pirouette_body::{Avatar, Bone, Pose, TurnAngle, pose_bones};
use pirouette_geom::TriMesh;
use pirouette_geom::outline_map::OutlineMap;
use serde_json::{Value, json};

use super::picture::{difference, side_by_side};
use super::{Effort, Experiment, Picture, camera_of};
use crate::people::Person;
use crate::score::girth::trunk_girth;
use crate::score::surface::surface_error;
use crate::score::volume::volume_iou;
use crate::table::{Cell, Table, mean};
use crate::trial::GIRTHS;
use crate::{OnStep, StudyError, do_all};

const VIEWS: usize = 8;

/// Heights of the girths
const LEVELS: [Measure; GIRTHS.len()] = [
    Measure::BustHeight,
    Measure::WaistHeight,
    Measure::HipHeight,
];

/// Construction of a body
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Case {
    /// The hull of the segmented silhouettes
    NotAligned,
    /// ... deformed by the published alignment (eq. 1)
    Aligned,
    /// ... and registered (eq. 2 to 4)
    Registered,
    /// ... and refined (eq. 5 to 7)
    Refined,
    /// ... refined without being registered
    RefinedOnly,
    /// The hull of silhouettes deformed by one skeleton for all views
    Shared,
    SharedRegistered,
    SharedRefined,
    /// The hull of silhouettes that the fitted body transforms to the reference pose
    FitHull,
    /// The fitted body
    Fit,
}

impl Case {
    const ALL: [Case; 10] = [
        Case::NotAligned,
        Case::Aligned,
        Case::Registered,
        Case::Refined,
        Case::RefinedOnly,
        Case::Shared,
        Case::SharedRegistered,
        Case::SharedRefined,
        Case::FitHull,
        Case::Fit,
    ];

    fn name(self) -> &'static str {
        match self {
            Case::NotAligned => "not aligned",
            Case::Aligned => "aligned, as published",
            Case::Registered => "aligned, registered",
            Case::Refined => "aligned, registered, refined",
            Case::RefinedOnly => "aligned, refined",
            Case::Shared => "one skeleton for all views",
            Case::SharedRegistered => "one skeleton, registered",
            Case::SharedRefined => "one skeleton, registered, refined",
            Case::FitHull => "hull of the fit",
            Case::Fit => "fitted body (ours)",
        }
    }

    /// Returns the steps of the cases that deform each view separately
    fn options(self) -> Option<NormalizeOptions> {
        let (method, register, refine) = match self {
            Case::NotAligned | Case::FitHull | Case::Fit => return None,
            Case::Aligned => (NormalizeMethod::ThreeStep, false, false),
            Case::Registered => (NormalizeMethod::ThreeStep, true, false),
            Case::Refined => (NormalizeMethod::ThreeStep, true, true),
            Case::RefinedOnly => (NormalizeMethod::ThreeStep, false, true),
            Case::Shared => (NormalizeMethod::SharedSkeleton, false, false),
            Case::SharedRegistered => (NormalizeMethod::SharedSkeleton, true, false),
            Case::SharedRefined => (NormalizeMethod::SharedSkeleton, true, true),
        };
        Some(NormalizeOptions {
            method,
            register: register.then(RegisterOptions::default),
            refine: refine.then(RefineOptions::default),
            ..NormalizeOptions::shared_skeleton()
        })
    }
}

/// Score of one body
#[derive(Debug, Clone, Copy, Default)]
struct Score {
    volume_iou: Option<f64>,
    mean_mm: Option<f64>,
    girths_pct: [Option<f64>; GIRTHS.len()],
}

/// Reconstructs people who sway, in eight views, step by step
///
/// # Errors
/// When cancelled.
pub(super) fn run(
    people: &[Person],
    effort: Effort,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<Experiment, StudyError> {
    let people = &people[..people.len().min(effort.pick(2, 12))];
    let jobs: Vec<(usize, &Person)> = people.iter().enumerate().collect();
    let scores = do_all(&jobs, cancel, on_step, |&(index, person)| {
        let bodies = bodies_of(person, cancel);
        let scores = bodies.each_ref().map(|body| score(person, body.as_ref()));
        let picture = (index == 0).then(|| picture_of(person, &bodies));
        let ours = scores[Case::Fit as usize].mean_mm;
        let text = ours.map_or("no body".into(), |mm| format!("{mm:.2} mm"));
        ((scores, picture), format!("{}: {text}", person.describe()))
    })?;
    let mut table = Table::new(
        format!("{} people in {VIEWS} views, means", people.len()),
        &[
            "body",
            "failed",
            "volume IoU",
            "surface mm",
            "worst mm",
            "bust %",
            "waist %",
            "hip %",
        ],
    );
    for (index, case) in Case::ALL.iter().enumerate() {
        let of: Vec<Score> = scores.iter().map(|(scores, _)| scores[index]).collect();
        let values = |value: &dyn Fn(&Score) -> Option<f64>| -> Vec<f64> {
            of.iter().filter_map(value).collect()
        };
        let surface = values(&|s| s.mean_mm);
        let mut row = vec![
            Cell::Text(case.name().into()),
            Cell::Number((of.len() - surface.len()) as f64, 0),
            Cell::number(mean(&values(&|s| s.volume_iou)), 3),
            Cell::number(mean(&surface), 2),
            Cell::number(surface.iter().copied().max_by(f64::total_cmp), 2),
        ];
        row.extend((0..GIRTHS.len()).map(|g| Cell::spread(&values(&|s| s.girths_pct[g]))));
        table.rows.push(row);
    }
    let values = people
        .iter()
        .zip(&scores)
        .flat_map(|(person, (scores, _))| {
            let cases = Case::ALL.iter().zip(scores);
            cases.map(|(case, score)| score.to_json(person, *case))
        });
    Ok(Experiment {
        name: "reconstruction",
        title: "3D reconstruction",
        reading: vec![
            "The paper shows pictures of bodies carved from silhouettes that were not aligned, aligned, registered and \
             refined, and gives no figures. Here, people with sway are rendered in eight views; their true silhouettes are \
             given, so that only the steps after segmentation matter, and noisy keypoints. The reference of the \
             published steps is a neutral mannequin of the person's stature.",
            "Surface is the mean distance between the reconstructed and the true body, in both directions, after a shift and a turn \
             about the vertical; the intersection over union of the volumes has the same alignment. Girths are tape lengths at the \
             true heights of bust, waist and hip, compared with the true ones. A hull of eight views is systematically too large: \
             opposite views see the same outline, so that a circle becomes an octagon with a 5.5 % larger perimeter.",
            "Further rows contain the same steps after an alignment of all views by one skeleton in space, and the effect of \
             registration and refinement there.",
        ],
        figures: Vec::new(),
        values: values.collect(),
        pictures: scores.into_iter().filter_map(|(_, p)| p).collect(),
        tables: vec![table],
    })
}

impl Score {
    fn to_json(self, person: &Person, case: Case) -> Value {
        let rounded = |value: Option<f64>| value.map(|v| (v * 1e4).round() / 1e4);
        let mut value = json!({
            "person": person.seed,
            "body": case.name(),
            "volume_iou": rounded(self.volume_iou),
            "surface_mm": rounded(self.mean_mm),
        });
        for (girth, pct) in GIRTHS.iter().zip(self.girths_pct) {
            value[format!("{}_pct", girth.name())] = json!(rounded(pct));
        }
        value
    }
}

/// Returns the bodies of all cases, `None` where reconstruction failed
fn bodies_of(person: &Person, cancel: &CancelToken) -> [Option<TriMesh>; Case::ALL.len()] {
    let scan = person.photograph(VIEWS, 1.0, false);
    let job = |method, goal, hull| {
        let mut config = Config::new(goal, method);
        config.hull = hull;
        run_job(&scan.scan, &config, cancel, &mut |_| {}).ok()
    };
    let fit = job(Method::Fit, Goal::Reconstruct, true);
    // The published steps, except for the last ones, which depend on the case.
    let skeleton = job(Method::ThreeStep, Goal::Segment, false);
    Case::ALL.map(|case| match case {
        Case::Fit => fit.as_ref()?.body.clone(),
        Case::FitHull => fit.as_ref()?.hull.clone(),
        _ => hull(case, skeleton.as_ref()?),
    })
}

/// Carves the hull of the silhouettes of one case
fn hull(case: Case, report: &Report) -> Option<TriMesh> {
    let skeleton = report.skeleton.as_ref()?;
    let reference = reference_of(case, report, skeleton);
    let options = case.options();
    let normalizer =
        options.map(|options| Normalizer::with_options(&skeleton.avatar, reference, options));
    let outlines: Vec<(&SolvedView, OutlineMap)> = report
        .views
        .iter()
        .filter_map(|view| {
            let soft = match &normalizer {
                Some(normalizer) => normalizer.normalize(view).ok()?.soft(),
                None => view.silhouette.soft.to_grid(),
            };
            Some((view, OutlineMap::new(&soft, OutlineMap::FAR_PX)))
        })
        .collect();
    let views: Vec<CarveView> = outlines
        .iter()
        .map(|(view, outline)| CarveView {
            outline,
            camera: view.skeleton().camera,
            turn: view.skeleton().turn,
        })
        .collect();
    carve(&views, &CarveOptions::default()).ok()
}

/// Returns the reference: the published steps estimate proportions from single photos, one skeleton from all views
fn reference_of<'a>(case: Case, report: &'a Report, skeleton: &'a Skeleton) -> &'a Avatar {
    match case {
        Case::Shared | Case::SharedRegistered | Case::SharedRefined => &skeleton.avatar,
        _ => &report.avatar,
    }
}

fn score(person: &Person, body: Option<&TriMesh>) -> Score {
    let Some(body) = body else {
        return Score::default();
    };
    let truth = &person.avatar.mesh;
    let true_measures = measure_avatar(&person.avatar);
    let true_value = |measure: Measure| {
        let mut all = true_measures.iter();
        all.find(|(m, _)| *m == measure).map(|(_, value)| *value)
    };
    Score {
        volume_iou: volume_iou(body, truth),
        mean_mm: surface_error(body, truth).map(|error| error.mean_mm),
        girths_pct: std::array::from_fn(|g| {
            let height = true_value(LEVELS[g])?;
            let (found, true_mm) = (trunk_girth(body, height)?, trunk_girth(truth, height)?);
            Some(100.0 * (found / true_mm - 1.0))
        }),
    }
}

/// Draws the bodies of the main cases over the true one, from the front and from the side
fn picture_of(person: &Person, bodies: &[Option<TriMesh>]) -> Picture {
    let shown = [
        Case::NotAligned,
        Case::Aligned,
        Case::Registered,
        Case::Refined,
        Case::Shared,
        Case::Fit,
    ];
    let camera = camera_of(person.avatar.stature_mm());
    let seen = |mesh: &TriMesh, degrees: f64| {
        let turn = TurnAngle::from_degrees(degrees);
        let posed = pose_bones(&person.avatar.bone_heads, &Pose::default(), turn);
        let root = posed.transforms[Bone::Root];
        let positions: Vec<_> = mesh
            .positions
            .iter()
            .map(|&p| root.transform_point3(p))
            .collect();
        silhouette(&positions, &mesh.triangles, &camera).threshold(0.5)
    };
    let parts: Vec<_> = shown
        .iter()
        .filter_map(|case| bodies[*case as usize].as_ref())
        .map(|body| {
            // Between two views, where the hull differs most
            let degrees = 22.5;
            difference(&seen(body, degrees), &seen(&person.avatar.mesh, degrees))
        })
        .collect();
    let names: Vec<&str> = shown.iter().map(|case| case.name()).collect();
    Picture {
        name: "reconstruction",
        caption: format!(
            "Outlines from 22.5 degrees, between two of the views, over the true one: {}",
            names.join("; ")
        ),
        photo: side_by_side(&parts.iter().collect::<Vec<_>>()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_true_body_has_no_error() {
        let person = Person::new(4).unwrap();
        let score = score(&person, Some(&person.avatar.mesh));
        assert!(score.volume_iou.unwrap() > 0.99);
        assert!(score.mean_mm.unwrap() < 0.5);
        for girth in score.girths_pct {
            assert!(girth.unwrap().abs() < 1e-9);
        }
    }

    #[test]
    fn cases_are_in_order_and_differ() {
        for (index, case) in Case::ALL.iter().enumerate() {
            assert_eq!(*case as usize, index);
            let same = Case::ALL.iter().filter(|c| c.options() == case.options());
            assert!(case.options().is_none() || same.count() == 1, "{case:?}");
        }
    }
}
