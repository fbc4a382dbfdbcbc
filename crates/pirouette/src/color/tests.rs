use super::*;
use pirouette_body::Bone;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_synthetic::SyntheticOptions;

const RED: [u8; 3] = [200, 40, 30];
const BLUE: [u8; 3] = [30, 60, 190];
const GREEN: [u8; 3] = [0, 255, 0];

/// A person whose left half is red and whose right half is blue, in front of a green wall
struct TwoColored {
    avatar: Avatar,
    views: Vec<(Photo, Mask, Camera, TurnAngle, Pose)>,
}

impl TwoColored {
    fn new(turns: &[f64]) -> Self {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let camera = SyntheticOptions::camera_for(avatar.stature_mm(), 400, 500);
        let views = turns.iter().map(|&degrees| {
            let turn = TurnAngle::from_degrees(degrees);
            let mut pose = Pose::default();
            pose.rotations[Bone::LeftUpperArm] = DVec3::Z * (degrees / 2000.0);
            pose.shift_mm = DVec3::X * (degrees / 10.0);
            let positions = avatar.posed(&pose, turn).positions;
            let triangles = &avatar.mesh.triangles;
            let nearest = render::nearest_surface(&positions, triangles, &camera);
            let photo = nearest.triangle.map(|&t| match triangles.get(t as usize) {
                None => GREEN,
                Some(&[v, ..]) if avatar.mesh.positions[v as usize].x > 0.0 => RED,
                Some(_) => BLUE,
            });
            let mask = render::silhouette(&positions, triangles, &camera).threshold(0.5);
            (photo, mask, camera, turn, pose)
        });
        let views = views.collect();
        Self { avatar, views }
    }

    fn views(&self) -> Vec<ColorView<'_>> {
        let mut views = Vec::new();
        for (photo, mask, camera, turn, pose) in &self.views {
            views.push(ColorView {
                photo,
                mask,
                camera: *camera,
                turn: *turn,
                pose: *pose,
            });
        }
        views
    }

    fn color(&self) -> SurfaceColors {
        let colors = color_surface(&self.avatar, &self.views(), &ColorOptions::default());
        colors.expect("the person is visible")
    }
}

fn like(color: [u8; 3], other: [u8; 3]) -> bool {
    color.iter().zip(other).all(|(a, b)| a.abs_diff(b) <= 12)
}

const EIGHT: [f64; 8] = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0];

#[test]
fn each_side_gets_its_own_color_and_none_of_the_wall() {
    let person = TwoColored::new(&EIGHT);
    let colors = person.color();
    let (mut right, mut total) = (0, 0);
    for (p, &color) in person.avatar.mesh.positions.iter().zip(&colors.srgb) {
        assert!(color[1] < 90, "the wall bleeds in at {p}: {color:?}");
        if p.x.abs() > 40.0 {
            total += 1;
            right += usize::from(like(color, if p.x > 0.0 { RED } else { BLUE }));
        }
    }
    let share = right as f64 / total as f64;
    assert!(share > 0.97, "{share}");
    let seen = colors.view_counts.iter().filter(|&&count| count > 1);
    assert!(seen.count() as f64 > 0.7 * colors.view_counts.len() as f64);
}

#[test]
fn unseen_vertices_are_filled_from_their_neighborhood() {
    let person = TwoColored::new(&[0.0]);
    let colors = person.color();
    let mut back = 0;
    for (v, p) in person.avatar.mesh.positions.iter().enumerate() {
        let (color, count) = (colors.srgb[v], colors.view_counts[v]);
        assert!(color[1] < 90 && color != [0; 3], "{p} {color:?}");
        if p.z < -80.0 {
            back += 1;
            assert_eq!(count, 0, "{p}");
        }
    }
    assert!(back > 100);
    // Far from the middle only one color occurs.
    let soles = person.avatar.mesh.positions.iter().zip(&colors.srgb);
    for (_, &color) in soles.filter(|(p, _)| p.y < 5.0) {
        assert!(like(color, RED) || like(color, BLUE), "{color:?}");
    }
}

#[test]
fn a_few_wrong_pixels_at_the_border_have_no_effect() {
    let mut person = TwoColored::new(&EIGHT);
    for (_, mask, ..) in &mut person.views {
        *mask = pirouette_geom::morphology::dilate(mask, 1.0);
    }
    let colors = person.color();
    let green = colors.srgb.iter().filter(|c| c[1] > 110).count();
    assert!(green < colors.srgb.len() / 100, "{green}");
}

#[test]
fn a_photo_that_shows_something_else_is_outvoted() {
    let mut person = TwoColored::new(&[-20.0, -10.0, 0.0, 10.0, 20.0]);
    person.views[2].0 = Photo::filled(400, 500, GREEN);
    let colors = person.color();
    let chest = person.avatar.mesh.positions.iter().zip(&colors.srgb);
    let chest =
        chest.filter(|(p, _)| p.z > 90.0 && p.x.abs() < 120.0 && p.y > 1100.0 && p.y < 1350.0);
    for (p, color) in chest {
        assert!(color[1] < 190, "{p} {color:?}");
    }
}

#[test]
fn an_unseen_body_gets_no_colors() {
    let person = TwoColored::new(&[0.0]);
    let options = ColorOptions::default();
    assert_eq!(color_surface(&person.avatar, &[], &options), None);
    let view = person.views()[0];
    let empty = Mask::filled(400, 500, false);
    let small = Photo::filled(3, 3, RED);
    let mut lost = Pose::default();
    lost.shift_mm.x = f64::NAN;
    let aside = Pose {
        shift_mm: DVec3::X * 1e9,
        ..Pose::default()
    };
    let blind = Camera {
        distance_mm: f64::NAN,
        ..view.camera
    };
    for bad in [
        ColorView {
            mask: &empty,
            ..view
        },
        ColorView {
            photo: &small,
            ..view
        },
        ColorView { pose: lost, ..view },
        ColorView {
            pose: aside,
            ..view
        },
        ColorView {
            camera: blind,
            ..view
        },
    ] {
        assert_eq!(color_surface(&person.avatar, &[bad], &options), None);
        let both = color_surface(&person.avatar, &[bad, view], &options).unwrap();
        let alone = color_surface(&person.avatar, &[view], &options).unwrap();
        assert_eq!(both, alone);
    }
}

#[test]
fn parts_not_connected_to_seen_vertices_get_the_mean_color() {
    let mut person = TwoColored::new(&[0.0]);
    let mesh = &mut person.avatar.mesh;
    let first = mesh.positions.len() as u32;
    let behind = DVec3::new(0.0, 1000.0, -300.0);
    let corners = [DVec3::ZERO, DVec3::X * 10.0, DVec3::Y * 10.0];
    mesh.positions.extend(corners.map(|c| behind + c));
    mesh.triangles.push([first, first + 2, first + 1]);
    let weight = person.avatar.weights[0];
    person.avatar.weights.extend([weight; 3]);
    // a vertex of no triangle
    person.avatar.mesh.positions.push(behind);
    person.avatar.weights.push(weight);
    let colors = person.color();
    let purple = colors.srgb[first as usize];
    assert!(purple[0] > 80 && purple[2] > 80, "{purple:?}");
    assert_eq!(colors.srgb.len(), person.avatar.mesh.positions.len());
}
