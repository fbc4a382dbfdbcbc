//! Pictures and times of decoded videos; skipped without the program ffmpeg.

#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test may panic, and reports why it is skipped"
)]

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::Command;

use pirouette::scan::Photo;
use pirouette::video::{Frame, FrameSource};
use pirouette_files::video::FfmpegVideo;

/// Runs ffmpeg; returns the file that it writes, `None` if there is no ffmpeg
fn made(folder: &Path, name: &str, arguments: &[&str]) -> Option<PathBuf> {
    let file = folder.join(name);
    let status = Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-y"])
        .args(arguments)
        .arg(&file)
        .status();
    let Ok(status) = status else {
        eprintln!("skipped: ffmpeg is not installed");
        return None;
    };
    assert!(status.success());
    Some(file)
}

fn frames(file: &Path, indices: Option<&[usize]>) -> (FfmpegVideo, Vec<Frame>) {
    let mut video = FfmpegVideo::open(file).unwrap();
    let mut frames = Vec::new();
    video
        .frames(1000, indices, &mut |frame| {
            frames.push(frame);
            ControlFlow::Continue(())
        })
        .unwrap();
    (video, frames)
}

/// Ten frames a second of 64 x 48 px, the left half white, the right half black
const HALVES: [&str; 4] = [
    "-f",
    "lavfi",
    "-i",
    "color=black:s=64x48:r=10:d=1,drawbox=x=0:y=0:w=32:h=48:color=white:t=fill,format=yuv420p",
];

fn gray(photo: &Photo, x: usize, y: usize) -> u8 {
    photo[(x, y)][1]
}

#[test]
fn the_rotation_of_phones_is_applied() {
    let folder = tempfile::tempdir().unwrap();
    let Some(stored) = made(folder.path(), "stored.mp4", &HALVES) else {
        return;
    };
    let (_, upright) = frames(&stored, None);
    let first = &upright[0].photo;
    assert_eq!((first.width(), first.height()), (64, 48));
    assert!(gray(first, 10, 24) > 200 && gray(first, 54, 24) < 50);
    let turned = [
        "-i",
        stored.to_str().unwrap(),
        "-c",
        "copy",
        "-metadata:s:v:0",
        "rotate=90",
    ];
    let turned = made(folder.path(), "turned.mp4", &turned).unwrap();
    let (_, turned) = frames(&turned, None);
    let first = &turned[0].photo;
    // Newer versions of ffmpeg ignore this way to store a rotation; then there is nothing to apply.
    if first.width() < first.height() {
        assert_eq!((first.width(), first.height()), (48, 64));
        assert!(gray(first, 24, 10).abs_diff(gray(first, 24, 54)) > 150);
        assert!(gray(first, 5, 10).abs_diff(gray(first, 43, 10)) < 50);
    }
    assert_eq!(turned.len(), 10);
}

#[test]
fn pixels_become_square() {
    let folder = tempfile::tempdir().unwrap();
    let wide = [&HALVES[..], &["-vf", "setsar=2/1"]].concat();
    let Some(wide) = made(folder.path(), "wide.mp4", &wide) else {
        return;
    };
    let (_, frames) = frames(&wide, None);
    let first = &frames[0].photo;
    assert_eq!((first.width(), first.height()), (128, 48));
    assert!(gray(first, 54, 24) > 200 && gray(first, 74, 24) < 50);
}

#[test]
fn times_are_those_of_the_file_at_a_variable_rate() {
    let folder = tempfile::tempdir().unwrap();
    // Frames 3 and 4 of ten are missing.
    let gaps = ["-vf", "select='not(between(n,3,4))'", "-vsync", "vfr"];
    let Some(gaps) = made(folder.path(), "gaps.mp4", &[&HALVES[..], &gaps].concat()) else {
        return;
    };
    let (video, all) = frames(&gaps, None);
    let times: Vec<f64> = all.iter().map(|frame| frame.time_s).collect();
    assert_eq!(times, [0.0, 0.1, 0.2, 0.5, 0.6, 0.7, 0.8, 0.9]);
    assert!(video.duration_s().is_some_and(|s| (s - 1.0).abs() < 0.11));
    let (_, some) = frames(&gaps, Some(&[1, 3]));
    let found: Vec<(usize, f64)> = some.iter().map(|f| (f.index, f.time_s)).collect();
    assert_eq!(found, [(1, 0.1), (3, 0.5)]);
}

#[test]
fn any_number_of_frames_can_be_selected() {
    let folder = tempfile::tempdir().unwrap();
    let long = "testsrc=s=64x48:r=100:d=4";
    let Some(long) = made(folder.path(), "long.mp4", &["-f", "lavfi", "-i", long]) else {
        return;
    };
    for count in [0, 1, 2, 99, 140, 400] {
        let wanted: Vec<usize> = (0..count).map(|i| i * (400 / count)).collect();
        let (_, some) = frames(&long, Some(&wanted));
        let found: Vec<usize> = some.iter().map(|frame| frame.index).collect();
        assert_eq!(found, wanted, "{count}");
    }
}

#[test]
fn a_high_dynamic_range_is_converted() {
    let folder = tempfile::tempdir().unwrap();
    // White paper, 203 cd/m2, is 58 % of the signal by the curve of ST 2084 (ITU-R BT.2408): 572 of 10 bits.
    let paper = "nullsrc=s=64x48:r=10:d=0.3,format=yuv420p10le,geq=lum=572:cb=512:cr=512";
    let tags = [
        "-color_trc",
        "smpte2084",
        "-color_primaries",
        "bt2020",
        "-colorspace",
        "bt2020nc",
        "-color_range",
        "tv",
        "-pix_fmt",
        "yuv420p10le",
    ];
    let arguments = [&["-f", "lavfi", "-i", paper][..], &tags].concat();
    let Some(paper) = made(folder.path(), "paper.mp4", &arguments) else {
        return;
    };
    let (video, all) = frames(&paper, None);
    assert!(video.is_hdr());
    let level = gray(&all[0].photo, 30, 20);
    // Without the conversion, it is 58 % of the signal here, too: 148.
    assert!(level > 185, "{level}");
    let (video, _) = frames(&made(folder.path(), "plain.mp4", &HALVES).unwrap(), None);
    assert!(!video.is_hdr());
}
