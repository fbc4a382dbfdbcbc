use super::*;
use crate::{Appearance, Clutter, SyntheticOptions, SyntheticScan, synthesize_dressed};
use pirouette::measure::{Measure, measure_avatar};
use pirouette_body::ReferencePose;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::section::{plane_section, tape_length};
use pirouette_geom::winding::WindingNumbers;

fn person() -> Avatar {
    mannequin(&MannequinParameters {
        pose: ReferencePose::A,
        ..MannequinParameters::default()
    })
    .expect("the average mannequin can be built")
}

fn with_hair(hair: Hair) -> Outfit {
    Outfit {
        hair,
        ..Outfit::tight()
    }
}

/// Returns the front view in a small photo
fn photographed(dressed: &Dressed) -> SyntheticScan {
    let options = SyntheticOptions {
        seed: 5,
        turns: SyntheticOptions::even_turns(1),
        camera: SyntheticOptions::camera_for(dressed.stature_mm, 200, 250),
        sway: 0.0,
        keypoint_noise_px: 0.0,
        turn_noise_radians: 0.0,
        sensor_noise: 0.0,
        clutter: Clutter::Plain,
        photos: false,
    };
    synthesize_dressed(dressed, &options, &Appearance::default())
}

#[test]
fn surfaces_are_closed_outside_of_the_body_and_stand_on_the_floor() {
    let avatar = person();
    for outfit in [
        Outfit::tight(),
        Outfit {
            sole_mm: 25.0,
            ..with_hair(Hair::Bun)
        },
        Outfit {
            hair: Hair::Long,
            ..Outfit::loose()
        },
        Outfit {
            hair: Hair::Afro,
            sole_mm: 35.0,
            ..Outfit::normal()
        },
        Outfit {
            hair: Hair::Hat,
            ..Outfit::skirt()
        },
    ] {
        let dressed = dress(&avatar, &outfit, 3);
        dressed.avatar.mesh.check().unwrap();
        dressed.avatar.check().unwrap();
        for piece in dressed.avatar.mesh.components() {
            piece.check().unwrap();
        }
        assert_eq!(dressed.materials.len(), dressed.avatar.mesh.positions.len());
        let body = avatar.clone().shifted(DVec3::Y * outfit.sole_mm);
        let (winding, surface) = (
            WindingNumbers::new(&body.mesh),
            NearestSurface::new(&body.mesh),
        );
        let vertices = dressed.avatar.mesh.positions.iter().zip(&dressed.materials);
        for (point, _) in vertices.filter(|(_, m)| **m == Material::Body).step_by(3) {
            let depth_mm = surface.nearest(*point).unwrap().distance;
            assert!(
                depth_mm < 1.0 || winding.at(*point) < 0.5,
                "{point} is {depth_mm} mm inside, {outfit:?}"
            );
        }
    }
}

#[test]
fn tight_clothes_without_shoes_are_the_body() {
    let avatar = person();
    let dressed = dress(&avatar, &Outfit::tight(), 3);
    assert_eq!(dressed.avatar.mesh.triangles, avatar.mesh.triangles);
    let places = dressed.avatar.mesh.positions.iter();
    let farthest = places
        .zip(&avatar.mesh.positions)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f64::max);
    assert!(farthest < 1e-6, "{farthest}");
}

#[test]
fn the_girth_at_the_waist_grows_by_the_ease() {
    let avatar = person();
    let measures = measure_avatar(&avatar);
    let waist = measures.iter().find(|(m, _)| *m == Measure::WaistHeight);
    let level = DVec3::Y * waist.unwrap().1;
    let girth = |mesh: &TriMesh| {
        let loops = plane_section(mesh, level, DVec3::Y);
        loops
            .iter()
            .map(|points| tape_length(points))
            .fold(0.0, f64::max)
    };
    for outfit in [Outfit::normal(), Outfit::loose()] {
        let dressed = dress(&avatar, &outfit, 3);
        let gain = girth(&dressed.avatar.mesh) - girth(&avatar.mesh);
        let ease = outfit.top.ease_mm;
        assert!((gain - ease).abs() < 0.2 * ease, "{gain} mm for {ease} mm");
    }
}

#[test]
fn soles_lift_keypoints_but_not_the_stated_stature() {
    let avatar = person();
    let outfit = Outfit {
        sole_mm: 25.0,
        ..Outfit::tight()
    };
    let dressed = dress(&avatar, &outfit, 3);
    for (shod, bare) in dressed.avatar.keypoints.iter().zip(&avatar.keypoints) {
        assert!((*shod - *bare - DVec3::Y * 25.0).length() < 1e-9);
    }
    let taller = dressed.avatar.stature_mm() - avatar.stature_mm();
    assert!((taller - 25.0).abs() < 1.0, "{taller}");
    let stated = photographed(&dressed).scan.stature_mm;
    assert_eq!(stated, Some(avatar.stature_mm()));
}

#[test]
fn a_skirt_closes_the_gap_between_the_legs() {
    let avatar = person();
    let knee = avatar.keypoints[pirouette_body::Joint::LeftKnee];
    let between = DVec3::new(0.0, knee.y + 60.0, knee.z);
    let shown = |outfit: &Outfit| {
        let truth = photographed(&dress(&avatar, outfit, 3)).truth;
        let place = truth.camera.project(between);
        truth.silhouettes[0][(place.x as usize, place.y as usize)]
    };
    assert!(!shown(&Outfit::normal()));
    assert!(shown(&Outfit::skirt()));
}

#[test]
fn hair_and_hats_enlarge_the_head() {
    let avatar = person();
    let area = |hair: Hair| {
        let truth = photographed(&dress(&avatar, &with_hair(hair), 3)).truth;
        let mask = &truth.silhouettes[0];
        mask.as_slice().iter().filter(|&&inside| inside).count()
    };
    let shaved = area(Hair::Shaved);
    for hair in [Hair::Bun, Hair::Long, Hair::Afro, Hair::Hat] {
        assert!(area(hair) > shaved, "{}", hair.name());
    }
    let taller = |hair| dress(&avatar, &with_hair(hair), 3).avatar.stature_mm();
    let hat = taller(Hair::Hat) - avatar.stature_mm();
    assert!((hat - 40.0).abs() < 2.0, "{hat}");
}

#[test]
fn seeds_determine_outfits() {
    assert_eq!(Outfit::random(4), Outfit::random(4));
    let different = (0..20).filter(|&s| Outfit::random(s) != Outfit::random(s + 1));
    assert!(different.count() > 10);
}
