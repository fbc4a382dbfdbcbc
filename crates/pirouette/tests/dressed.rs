//! Scans of people in skirts and shoes.

use pirouette::measure::{Measure, Part, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, Report, Warning, run};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, Sex};
use pirouette_synthetic::wardrobe::{Outfit, dress};
use pirouette_synthetic::{
    Appearance, Clutter, SyntheticOptions, SyntheticScan, synthesize_dressed,
};

fn woman() -> Avatar {
    mannequin(&MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(1650.0),
        ..MannequinParameters::default()
    })
    .expect("an average mannequin")
}

/// Returns a scan with exact silhouettes of a dressed woman who sways
fn dressed(outfit: &Outfit) -> SyntheticScan {
    let avatar = woman();
    let options = SyntheticOptions {
        seed: 9,
        turns: SyntheticOptions::even_turns(8),
        camera: SyntheticOptions::camera_for(avatar.stature_mm(), 320, 400),
        sway: 1.0,
        keypoint_noise_px: 2.0,
        turn_noise_radians: 0.0,
        sensor_noise: 0.0,
        clutter: Clutter::Plain,
        photos: false,
    };
    synthesize_dressed(&dress(&avatar, outfit, 9), &options, &Appearance::default())
}

fn measured(scan: &SyntheticScan) -> Report {
    let config = Config::new(Goal::Measure, Method::Fit);
    run(&scan.scan, &config, &CancelToken::default(), &mut |_| {}).expect("the scan has results")
}

/// Returns error and standard deviation of a measure against the naked, barefoot body, in mm
fn error_mm(report: &Report, measure: Measure) -> [f64; 2] {
    let truth = measure_avatar(&woman());
    let (_, true_mm) = truth
        .iter()
        .find(|(other, _)| *other == measure)
        .expect("the mannequin has every measure");
    let found = report.measurements.as_ref().expect("not refused");
    let found = found.get(measure).estimate().expect("not missing");
    [found.value_mm - true_mm, found.sd_mm]
}

#[test]
fn a_skirt_is_found_and_the_body_below_is_estimated() {
    let report = measured(&dressed(&Outfit::skirt()));
    let warned = |w: &Warning| matches!(w, Warning::Skirt { .. });
    assert!(report.warnings.iter().any(warned), "{:?}", report.warnings);
    let found = report.measurements.as_ref().expect("not refused");
    let clothes = found.clothes.as_ref().expect("the survey holds");
    let bottom = clothes
        .covering(Part::Bottom)
        .expect("all parts are judged");
    assert!(clothes.skirt && bottom.covered > 0.9, "{clothes:?}");
    for measure in [Measure::HipGirth, Measure::ThighGirth, Measure::WaistGirth] {
        let [error, sd] = error_mm(&report, measure);
        assert!(error.abs() < 3.0 * sd, "{measure:?}: {error} ± {sd}");
    }
    let surface = &report
        .dressed
        .as_ref()
        .expect("a surface with the skirt")
        .avatar
        .mesh;
    assert_eq!(surface.check(), Ok(()));
    let body = report.body.as_ref().expect("a body");
    assert!(surface.volume() > 1.02 * body.volume());
}

#[test]
fn soles_are_no_part_of_heights_if_they_are_stated() {
    let sole_mm = 30.0;
    let mut shod = dressed(&Outfit {
        sole_mm,
        ..Outfit::tight()
    });
    let unstated = error_mm(&measured(&shod), Measure::CrotchHeight);
    shod.scan.subject.sole_mm = Some(sole_mm);
    shod.scan.stature_mm = shod.scan.stature_mm.map(|barefoot| barefoot + sole_mm);
    let report = measured(&shod);
    let stated = error_mm(&report, Measure::CrotchHeight);
    assert!(
        stated[0].abs() < 0.6 * unstated[0].abs(),
        "{stated:?} {unstated:?}"
    );
    let stature = error_mm(&report, Measure::Stature);
    assert!(stature[0].abs() < 1e-6, "{stature:?}");
}
