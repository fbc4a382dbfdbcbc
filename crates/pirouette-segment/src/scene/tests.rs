use super::*;

const WIDTH: usize = 60;
const HEIGHT: usize = 60;

/// Photo, seeds and truth
type Example = (Grid<[u8; 3]>, Grid<Seed>, Mask);

/// A wall with a poster in the person's own color, and a person (an upright bar) at column `at`
fn view(at: usize, camera_shift: usize) -> Example {
    let truth = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
        (at..at + 10).contains(&x) && (15..55).contains(&y)
    });
    let photo = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
        let noise = ((x * 7919 + y * 104_729 + at * 31) % 9) as u8;
        let wall = x + camera_shift;
        if truth[(x, y)] || ((24..36).contains(&wall) && (5..25).contains(&y)) {
            [150 + noise, 60, 40 + noise]
        } else if (wall / 3).is_multiple_of(2) {
            [90 + noise, 110, 120]
        } else {
            [60, 80 + noise, 90]
        }
    });
    let seeds = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
        let to_the_side = x.abs_diff(at + 5);
        match y {
            20..50 if to_the_side < 2 => Seed::Person,
            12..58 if to_the_side < 5 => Seed::ProbablePerson,
            8..59 if to_the_side < 16 => Seed::ProbableBackground,
            _ => Seed::Background,
        }
    });
    (photo, seeds, truth)
}

fn run(views: &[Example], options: &SceneOptions) -> (SceneResult, f64) {
    let scene: Vec<_> = views
        .iter()
        .map(|(photo, seeds, _)| SceneView {
            photo,
            seeds,
            prior: None,
            scale: 0.3,
        })
        .collect();
    let result = segment_scene(&scene, options, &|| false);
    let worst = result
        .masks
        .iter()
        .zip(views)
        .map(|(mask, (_, _, truth))| mask.as_ref().map_or(0.0, |m| m.mask.iou(truth)))
        .fold(1.0, f64::min);
    (result, worst)
}

#[test]
fn the_plate_tells_the_person_from_a_poster_of_the_same_color() {
    let views: Vec<_> = [3, 12, 36, 47].map(|at| view(at, 0)).into();
    let (result, with_plate) = run(&views, &SceneOptions::default());
    assert!(result.plate_used);
    assert!(with_plate > 0.95, "{with_plate}");
    let options = SceneOptions {
        plate: None,
        ..SceneOptions::default()
    };
    let (result, without) = run(&views, &options);
    assert!(
        !result.plate_used && without < with_plate,
        "{without} {with_plate}"
    );
}

#[test]
fn a_moving_camera_gets_no_plate_but_masks() {
    let views: Vec<_> = (0..5).map(|i| view(5 + 9 * i, 3 * i)).collect();
    let (result, worst) = run(&views, &SceneOptions::default());
    assert!(!result.plate_used);
    assert!(worst > 0.6, "{worst}");
}

#[test]
fn views_of_other_sizes_and_bad_ones_take_no_other_down() {
    let mut views: Vec<_> = [5, 25, 45].map(|at| view(at, 0)).into();
    let (photo, seeds, truth) = view(30, 0);
    views.push((
        photo.crop(10, 0, 50, 60),
        seeds.crop(10, 0, 50, 60),
        truth.crop(10, 0, 50, 60),
    ));
    views.push((photo, Grid::filled(3, 3, Seed::Person), truth));
    let (result, _) = run(&views, &SceneOptions::default());
    assert!(result.masks[..4].iter().all(Result::is_ok));
    assert!(matches!(result.masks[4], Err(GrabCutError::Size { .. })));
}

#[test]
fn decided_views_stay_as_they_are_and_cancelling_stops() {
    let views: Vec<_> = [5, 25].map(|at| view(at, 0)).into();
    let decided = views[0]
        .2
        .map(|&v| if v { Seed::Person } else { Seed::Background });
    let scene = [
        SceneView {
            photo: &views[0].0,
            seeds: &decided,
            prior: None,
            scale: 0.3,
        },
        SceneView {
            photo: &views[1].0,
            seeds: &views[1].1,
            prior: None,
            scale: 0.3,
        },
    ];
    let result = segment_scene(&scene, &SceneOptions::default(), &|| false);
    assert_eq!(result.masks[0].as_ref().unwrap().mask, views[0].2);
    let stopped = segment_scene(&scene, &SceneOptions::default(), &|| true);
    assert!(matches!(stopped.masks[1], Err(GrabCutError::Cancelled)));
    assert!(
        segment_scene(&[], &SceneOptions::default(), &|| false)
            .masks
            .is_empty()
    );
}
