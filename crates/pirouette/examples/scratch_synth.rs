use pirouette::avatar::*;
use pirouette::synthetic::*;
fn main() {
    let pars: Vec<String> = std::env::args().collect();
    let avatar = if pars[1] == "m" {
        mannequin::mannequin(&mannequin::MannequinParameters {
            sex: mannequin::Sex::Female,
            mass_kg: Some(78.0),
            ..Default::default()
        })
        .unwrap()
    } else {
        gltf::load_avatar(&std::fs::read(&pars[1]).unwrap(), ReferencePose::A).unwrap()
    };
    let t = std::time::Instant::now();
    let s = synthesize(
        &avatar,
        &SyntheticOptions {
            seed: std::env::args().nth(2).map_or(3, |v| v.parse().unwrap()),
            turns: SyntheticOptions::even_turns(8),
            camera: SyntheticOptions::camera_for(avatar.stature_mm(), 800, 1000),
            sway: 1.0,
            keypoint_noise_px: 2.5,
            sensor_noise: 2.0,
            clutter: Clutter::LivedIn,
        },
    );
    eprintln!("{:?}", t.elapsed());
    for (i, v) in s.scan.views.iter().enumerate() {
        let mut b = Vec::new();
        for p in v.photo.as_slice() {
            b.extend_from_slice(p);
        }
        image::save_buffer(
            format!("/tmp/synth{i}.png"),
            &b,
            800,
            1000,
            image::ColorType::Rgb8,
        )
        .unwrap();
    }
}
