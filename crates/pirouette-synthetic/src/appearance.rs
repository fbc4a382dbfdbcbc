//! Tone of the skin and light of the photos, for studies of programs that look at photos.

use glam::DVec3;
use pirouette_geom::Grid;

use super::room::Light;
use pirouette_body::{Camera, render};

/// What varies between photos of one person in one room
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Appearance {
    /// Tone of the skin from 0 (darkest) to 1 (lightest); random, from 0.25 on, if absent
    pub skin_tone: Option<f64>,
    /// Light of person and room
    pub lighting: Lighting,
}

/// Light of the photos
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lighting {
    /// Bright, from a wide window beside the camera
    #[default]
    Even,
    /// A sixteenth of the light, with four times the sensor noise
    Dim,
    /// A lamp at the right of the photo: the other side of the person is nearly dark
    Side,
    /// A bright room behind a dark person
    Back,
}

/// Light in a dim room, relative to [`Lighting::Even`]
const DIM: f32 = 1.0 / 16.0;

/// Position of the lamp at the side in the room, in mm: x right in the photo, y up, z toward the camera
///
/// It is near: its light decreases across the body, and the front is lit at a flat angle. A far one would light the inner
/// side of the other arm and leg as much, since bodies cast no shadows here.
const LAMP_MM: DVec3 = DVec3::new(700.0, 1200.0, 200.0);

/// Distance from which on surfaces get no more light, in mm: arms may reach the lamp
const MIN_LAMP_MM: f64 = 300.0;

/// Light on surfaces that face away from the lamp, and that is added at the turning axis to those that face it
const SIDE_LIGHT: [f64; 2] = [0.03, 1.5];

/// Light on the room at the left and the right of the photo
const SIDE_ROOM: [f32; 2] = [0.15, 1.1];

/// Light on the room and on the person against the light
const BACK_ROOM: f32 = 3.0;
const BACK_PERSON: f32 = 0.08;

impl Lighting {
    /// All kinds of light
    pub const ALL: [Lighting; 4] = [
        Lighting::Even,
        Lighting::Dim,
        Lighting::Side,
        Lighting::Back,
    ];

    /// Returns a name for tables
    pub fn name(self) -> &'static str {
        match self {
            Lighting::Even => "even",
            Lighting::Dim => "dim",
            Lighting::Side => "side",
            Lighting::Back => "back",
        }
    }

    /// Returns the sensor noise relative to [`Lighting::Even`]
    pub(super) fn noise_gain(self) -> f64 {
        match self {
            Lighting::Dim => 4.0,
            _ => 1.0,
        }
    }

    /// Changes the light of the empty room
    pub(super) fn light_room(self, room: &mut Light) {
        let width = room.width().max(1) as f32;
        let [left, right] = match self {
            Lighting::Even => return,
            Lighting::Dim => [DIM; 2],
            Lighting::Side => SIDE_ROOM,
            Lighting::Back => [BACK_ROOM; 2],
        };
        for y in 0..room.height() {
            for (x, pixel) in room.row_mut(y).iter_mut().enumerate() {
                let gain = left + (right - left) * (x as f32 / width);
                *pixel = pixel.map(|v| v * gain);
            }
        }
    }

    /// Changes the light of the rendered person
    pub(super) fn light_person(
        self,
        layer: &mut render::Layer,
        mesh: &render::SilhouetteMesh,
        positions: &[DVec3],
        camera: &Camera,
    ) {
        let gain = match self {
            Lighting::Even => return,
            Lighting::Dim => Grid::filled(camera.width_px, camera.height_px, DIM),
            Lighting::Back => Grid::filled(camera.width_px, camera.height_px, BACK_PERSON),
            Lighting::Side => side_gain(mesh, positions, camera),
        };
        for (color, gain) in layer.color.as_mut_slice().iter_mut().zip(gain.as_slice()) {
            *color = color.map(|v| v * gain);
        }
    }
}

/// Returns the light of the lamp at the side on each pixel, divided by the light of the renderer
///
/// The factor replaces the light of the renderer, which is from the other side.
fn side_gain(mesh: &render::SilhouetteMesh, positions: &[DVec3], camera: &Camera) -> Grid<f32> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let normal = (b - a).cross(c - a);
        for &vertex in triangle {
            normals[vertex as usize] += normal;
        }
    }
    let [ambient, lamp] = SIDE_LIGHT;
    let gains: Vec<[f32; 3]> = normals
        .iter()
        .zip(positions)
        .map(|(normal, &position)| {
            let toward = LAMP_MM - position;
            let facing = normal.normalize_or_zero().dot(toward.normalize_or_zero());
            let nearness = LAMP_MM.x.powi(2) / toward.length_squared().max(MIN_LAMP_MM.powi(2));
            [(ambient + lamp * nearness * facing.max(0.0)) as f32; 3]
        })
        .collect();
    // The renderer has a fixed light: it lights bodies with the gains as color, white, and black, which has the highlights
    // alone. Below 1 it is not clipped.
    let shade = |colors: &[[f32; 3]], scale: f32| {
        let dark = move |color: [f32; 3]| color.map(|v| v * scale);
        render::shade_layer(mesh, positions, camera, dark, Some(colors)).color
    };
    const SCALE: f32 = 0.3;
    let lit = shade(&gains, SCALE);
    let uniform = vec![[1.0; 3]; positions.len()];
    let [white, black] = [SCALE, 0.0].map(|scale| shade(&uniform, scale));
    Grid::from_fn(camera.width_px, camera.height_px, |x, y| {
        let [lit, white, black] = [&lit, &white, &black].map(|picture| picture[(x, y)][0]);
        let renderer = (white - black) / SCALE;
        if renderer > 0.0 {
            (lit - black) / SCALE / renderer.powi(2)
        } else {
            1.0
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clutter, SyntheticOptions, SyntheticScan, synthesize_in};
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    fn photographed(appearance: Appearance) -> SyntheticScan {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let options = SyntheticOptions {
            seed: 5,
            turns: SyntheticOptions::even_turns(1),
            camera: SyntheticOptions::camera_for(avatar.stature_mm(), 120, 150),
            sway: 0.0,
            keypoint_noise_px: 0.0,
            turn_noise_radians: 0.0,
            sensor_noise: 0.0,
            clutter: Clutter::Plain,
            photos: true,
        };
        synthesize_in(&avatar, &options, &appearance)
    }

    /// Returns the mean level of the person's left and right half in the photo, and of the room behind no part of the person
    fn levels(scan: &SyntheticScan) -> [f64; 3] {
        let (photo, mask) = (&scan.scan.views[0].photo, &scan.truth.silhouettes[0]);
        let (width, height) = (photo.width(), photo.height());
        // The person covers less than half of some pixels outside the mask.
        let near_person = |x: usize, y: usize| {
            let rows = y.saturating_sub(3)..(y + 4).min(height);
            let columns = x.saturating_sub(3)..(x + 4).min(width);
            rows.into_iter()
                .any(|y| columns.clone().any(|x| mask[(x, y)]))
        };
        let mut sums = [(0.0, 0.0); 3];
        for y in 0..height {
            for x in 0..width {
                let part = match (mask[(x, y)], 2 * x < width) {
                    (true, true) => 0,
                    (true, false) => 1,
                    (false, _) if near_person(x, y) => continue,
                    (false, _) => 2,
                };
                sums[part].0 += photo[(x, y)].iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
                sums[part].1 += 1.0;
            }
        }
        sums.map(|(sum, count)| sum / count)
    }

    #[test]
    fn light_and_skin_change_the_photo_but_not_the_person() {
        let with = |lighting| {
            photographed(Appearance {
                lighting,
                skin_tone: Some(0.5),
            })
        };
        let [even, dim, side, back] = Lighting::ALL.map(with);
        assert_eq!(even.truth.silhouettes, side.truth.silhouettes);
        assert_eq!(even.truth.silhouettes, back.truth.silhouettes);
        let [even, dim, side, back] = [even, dim, side, back].map(|scan| levels(&scan));
        assert!(
            (0..3).all(|part| dim[part] < 0.5 * even[part]),
            "{dim:?} {even:?}"
        );
        assert!(
            side[1] > 1.5 * side[0],
            "the lamp is on the right: {side:?}"
        );
        assert!(
            back[0] < 0.5 * even[0] && back[2] > even[2],
            "{back:?} {even:?}"
        );

        let toned = |tone| {
            let skin_tone = Some(tone);
            levels(&photographed(Appearance {
                skin_tone,
                ..Appearance::default()
            }))
        };
        let (dark, light) = (toned(0.0), toned(1.0));
        assert!(
            dark[0] < light[0] && dark[2] == light[2],
            "{dark:?} {light:?}"
        );
    }
}
