//! The command line: help, exit codes, output for people and programs.

mod common;

use common::{Folders, pirouette, text};

const COMMANDS: [&str; 13] = [
    "compare",
    "scan",
    "segment",
    "normalize",
    "reconstruct",
    "measure",
    "avatar",
    "arap",
    "eval",
    "check",
    "keypoints",
    "models",
    "completions",
];

#[test]
fn every_command_has_help_with_examples() {
    let run = pirouette(&["--help"]).exits_with(0);
    for command in COMMANDS {
        assert!(run.stdout().contains(command), "{command}");
        let help = pirouette(&[command, "--help"]).exits_with(0).stdout();
        assert!(help.contains("Examples:"), "{command}: {help}");
        assert!(help.contains(&format!("pirouette {command}")), "{command}");
    }
}

#[test]
fn invalid_usage_exits_with_2() {
    for args in [
        &["scam", "x"][..],
        &["scan"],
        &["scan", "x", "--format", "doc"],
        &["scan", "x", "--method", "magic"],
        &["scan", "x", "--jobs", "0"],
        &["arap"],
        &[],
    ] {
        pirouette(args).exits_with(2);
    }
}

#[test]
fn failures_exit_with_1_and_one_line() {
    let run = pirouette(&["scan", "nowhere", "--json"]).exits_with(1);
    let error = run.stderr();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.starts_with("error: "), "{error}");
    let line = run.json_line();
    assert_eq!(line["ok"], false);
    assert!(line["error"].as_str().unwrap().contains("nowhere"));
}

#[test]
fn completions_are_printed_for_each_shell() {
    for shell in ["bash", "zsh", "fish"] {
        let run = pirouette(&["completions", shell]).exits_with(0);
        assert!(run.stdout().contains("pirouette"), "{shell}");
    }
}

/// No output is lost silently, whichever command prints
#[cfg(target_os = "linux")]
#[test]
fn full_standard_output_is_one_clear_error() {
    let folders = Folders::empty();
    let file = folders.path("a.off");
    for args in [&["completions", "bash"][..], &["avatar", "-o", text(&file)]] {
        let full = std::fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin("pirouette"))
            .args(args)
            .stdout(full)
            .output()
            .unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("standard output"), "{error}");
    }
}

#[test]
fn a_missing_output_folder_is_named() {
    let folders = Folders::empty();
    let out = folders.path("none/a.png");
    let error = pirouette(&["avatar", "-o", text(&out)])
        .exits_with(1)
        .stderr();
    assert!(
        error.contains("there is no folder") && error.contains("create it first"),
        "{error}"
    );
}

const SQUARE: &str = "OFF\n5 4 0\n0 0 0\n10 0 0\n10 10 0\n0 10 0\n5 5 0\n\
    3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";

#[test]
fn arap_moves_all_other_vertices() {
    let folders = Folders::empty();
    let mesh = folders.write("in.off", SQUARE);
    let source = folders.write("source.csv", "x,y\n0,0\n10,0\n");
    let target = folders.write("target.csv", "3,4\n13,4\n");
    let out = folders.path("deformed.off");
    pirouette(&[
        "arap",
        "--mesh",
        text(&mesh),
        "--source",
        text(&source),
        "--target",
        text(&target),
        "-o",
        text(&out),
    ])
    .exits_with(0);
    let written = std::fs::read(&out).unwrap();
    let deformed = pirouette_files::formats::mesh::read_off(&written).unwrap();
    for (index, (x, y)) in [
        (3.0, 4.0),
        (13.0, 4.0),
        (13.0, 14.0),
        (3.0, 14.0),
        (8.0, 9.0),
    ]
    .into_iter()
    .enumerate()
    {
        let point = deformed.positions[index];
        let off = (point.x - x).abs() + (point.y - y).abs() + point.z.abs();
        assert!(off < 1e-3, "vertex {index} is at {point}");
    }
}

#[test]
fn arap_writes_the_format_of_the_file_name() {
    let folders = Folders::empty();
    let mesh = folders.write("in.off", SQUARE);
    let points = folders.write("points.csv", "0,0\n10,0\n");
    let run = |out: &std::path::Path| {
        let points = text(&points);
        pirouette(&[
            "arap",
            "--mesh",
            text(&mesh),
            "--source",
            points,
            "--target",
            points,
            "-o",
            text(out),
        ])
    };
    let ply = folders.path("out.ply");
    run(&ply).exits_with(0);
    let read = pirouette_files::formats::mesh::read_ply(&std::fs::read(&ply).unwrap());
    assert_eq!(read.unwrap().positions.len(), 5);
    let unknown = folders.path("out.glb");
    let error = run(&unknown).exits_with(1).stderr();
    assert!(error.contains(".off, .obj, .ply or .stl"), "{error}");
    assert!(!unknown.exists());
}

#[test]
fn arap_names_the_invalid_line() {
    let folders = Folders::empty();
    let mesh = folders.write("in.off", SQUARE);
    let source = folders.write("source.csv", "0,0\n10\n");
    let target = folders.write("target.csv", "3,4\n");
    let out = folders.path("deformed.off");
    let run = |source: &std::path::Path| {
        pirouette(&[
            "arap",
            "--mesh",
            text(&mesh),
            "--source",
            text(source),
            "--target",
            text(&target),
            "-o",
            text(&out),
        ])
        .exits_with(1)
        .stderr()
    };
    let error = run(&source);
    assert!(
        error.contains("source.csv") && error.contains("line 2"),
        "{error}"
    );
    let unequal = folders.write("two.csv", "0,0\n10,0\n");
    let error = run(&unequal);
    assert!(
        error.contains("2 points") && error.contains("has 1"),
        "{error}"
    );
    assert!(!out.exists());
}

#[test]
fn a_mesh_is_measured() {
    let folders = Folders::empty();
    let mesh = folders.path("woman.glb");
    let make = ["avatar", "--sex", "female", "--stature", "1650", "--mass"];
    pirouette(&[&make[..], &["64", "-o", text(&mesh)]].concat()).exits_with(0);
    let out = folders.path("out");
    let run = pirouette(&["measure", text(&mesh), "-o", text(&out), "--json"]).exits_with(0);
    let found = run.json_line();
    assert_eq!(found["scale"], "mesh", "{found}");
    let value = |key: &str| found["measurements_mm"][key].as_f64().unwrap();
    assert!((value("stature") - 1650.0).abs() < 2.0, "{found}");
    assert!((700.0..900.0).contains(&value("waist_girth")), "{found}");
    for file in ["body.ply", "tapes.jpg", "measurements.json", "result.json"] {
        assert!(out.join(file).exists(), "{file}");
    }

    // The result does not differ from itself.
    let changes = folders.path("changes");
    let run = pirouette(&["compare", text(&out), text(&out), "-o", text(&changes)]).exits_with(0);
    assert!(run.stdout().contains("waist girth") && !run.stdout().contains('*'));
    assert!(changes.join("compare.json").exists() && changes.join("changes.ply").exists());
    let run = pirouette(&["compare", text(&out), text(&changes)]).exits_with(1);
    assert!(
        run.stderr().contains("measurements.json"),
        "{}",
        run.stderr()
    );

    // A mesh that cannot be measured is one clear error, and removes the earlier result.
    let broken = folders.write("broken.obj", "v 0 0 0\nf 1 2 3\n");
    let run = pirouette(&["measure", text(&broken), "-o", text(&out)]).exits_with(1);
    let error = run.stderr();
    assert!(
        error.contains("broken.obj") && error.contains("line 2"),
        "{error}"
    );
    assert!(!out.join("result.json").exists());
    let run = pirouette(&["measure", text(&mesh), "--angles", "unknown"]).exits_with(1);
    assert!(run.stderr().contains("not for meshes"), "{}", run.stderr());
    let run = pirouette(&["measure", text(&folders.scan()), "--up", "z"]).exits_with(1);
    assert!(run.stderr().contains("for meshes"), "{}", run.stderr());
}

#[test]
fn the_avatar_is_written_as_an_image_or_a_mesh() {
    let folders = Folders::empty();
    for (file, start) in [
        ("a.png", &b"\x89PNG"[..]),
        ("a.glb", b"glTF"),
        ("a.ply", b"ply\n"),
        ("a.off", b"OFF\n"),
    ] {
        let out = folders.path(file);
        pirouette(&[
            "avatar",
            "--sex",
            "female",
            "--stature",
            "1650",
            "-o",
            text(&out),
        ])
        .exits_with(0);
        assert!(std::fs::read(&out).unwrap().starts_with(start), "{file}");
    }
    let out = folders.path("a.doc");
    let run = pirouette(&["avatar", "-o", text(&out)]).exits_with(1);
    assert!(run.stderr().contains(".png"), "{}", run.stderr());
    let out = folders.path("b.png");
    let run = pirouette(&["avatar", "--stature", "17", "-o", text(&out)]).exits_with(1);
    assert!(run.stderr().contains("17 mm"), "{}", run.stderr());
}
