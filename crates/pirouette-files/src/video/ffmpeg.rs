//! Decoding by the program `ffmpeg`, which reads all usual containers and codecs.
//!
//! Pictures come through a pipe, upright (the rotation of phones is applied) and with square pixels; their times come
//! from the messages of the filter `showinfo`, so that variable frame rates are right.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use pirouette::video::{Frame, FrameSource};
use serde_json::Value;
use thiserror::Error;

use super::ppm::read_ppm;

/// A video file
#[derive(Debug, Clone)]
pub struct FfmpegVideo {
    path: PathBuf,
    /// Duration by the container, in s
    duration_s: Option<f64>,
    /// Whether brightness is coded for screens of high dynamic range
    hdr: bool,
}

/// Why a video cannot be decoded
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum VideoError {
    #[error(
        "videos are decoded by the program ffmpeg, which is not installed: apt install ffmpeg (Debian, Ubuntu), \
         brew install ffmpeg (macOS), winget install ffmpeg (Windows)"
    )]
    NoFfmpeg,
    #[error("{program} cannot be started: {source}")]
    Start {
        program: &'static str,
        #[source]
        source: io::Error,
    },
    #[error("{} contains no video", path.display())]
    NoVideo { path: PathBuf },
    #[error("{} cannot be decoded: {message}", path.display())]
    Damaged { path: PathBuf, message: String },
    #[error("{} cannot be written: {message}", path.display())]
    Write { path: PathBuf, message: String },
    #[error("the pictures of {} cannot be read: {source}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: io::Error,
    },
}

impl FfmpegVideo {
    /// Opens a video file, and reads its properties
    ///
    /// # Errors
    /// When `ffmpeg` is not installed, or the file contains no video.
    pub fn open(path: &Path) -> Result<Self, VideoError> {
        let mut probe = Command::new("ffprobe");
        probe
            .args(["-v", "error", "-protocol_whitelist", "file,pipe"])
            .args(["-select_streams", "V:0", "-of", "json"])
            .args([
                "-show_entries",
                "stream=width,color_transfer:format=duration",
            ])
            .arg(input(path))
            .stdin(Stdio::null());
        let output = probe.output().map_err(|e| cannot_start("ffprobe", e))?;
        if !output.status.success() {
            return Err(VideoError::Damaged {
                path: path.to_owned(),
                message: last_line(&String::from_utf8_lossy(&output.stderr), path),
            });
        }
        let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let stream = &found["streams"][0];
        if stream.is_null() {
            return Err(VideoError::NoVideo {
                path: path.to_owned(),
            });
        }
        let duration = found["format"]["duration"].as_str();
        let transfer = stream["color_transfer"].as_str();
        Ok(Self {
            path: path.to_owned(),
            duration_s: duration.and_then(|text| text.parse().ok()),
            hdr: transfer.is_some_and(|name| ["smpte2084", "arib-std-b67"].contains(&name)),
        })
    }

    /// Returns the path of the file
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the duration by the container, in s
    pub fn duration_s(&self) -> Option<f64> {
        self.duration_s
    }

    /// Returns whether the video has a high dynamic range (HLG or PQ), which is converted to the usual one
    pub fn is_hdr(&self) -> bool {
        self.hdr
    }

    /// Returns the filters that select, convert and shrink frames, and report their times
    fn filters(&self, max_side_px: usize, indices: Option<&[usize]>) -> String {
        let mut filters = Vec::new();
        if let Some(indices) = indices {
            filters.push(format!("select='{}'", any_of(indices)));
        }
        if self.hdr {
            // 203 cd/m2 is the brightness of white paper (ITU-R BT.2408).
            filters.push("zscale=t=linear:npl=203,format=gbrpf32le".to_owned());
            filters.push("zscale=p=bt709,tonemap=mobius:desat=0".to_owned());
            filters.push("zscale=t=bt709:m=bt709:r=tv,format=yuv420p".to_owned());
        }
        let factor = format!("min(1,{max_side_px}/max(iw*sar,ih))");
        filters.push(format!(
            "scale=w='max(2,round({factor}*iw*sar))':h='max(2,round({factor}*ih))':flags=area,setsar=1"
        ));
        filters.push("showinfo=checksum=0".to_owned());
        filters.join(",")
    }

    fn start(&self, max_side_px: usize, indices: Option<&[usize]>) -> Result<Child, VideoError> {
        let mut command = Command::new("ffmpeg");
        command
            .args(["-nostdin", "-hide_banner", "-nostats", "-loglevel", "info"])
            .args(["-protocol_whitelist", "file,pipe", "-i"])
            .arg(input(&self.path))
            .args(["-map", "0:V:0", "-vf", &self.filters(max_side_px, indices)])
            .args([
                "-vsync",
                "passthrough",
                "-c:v",
                "ppm",
                "-f",
                "image2pipe",
                "pipe:1",
            ])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command.spawn().map_err(|e| cannot_start("ffmpeg", e))
    }
}

/// Returns an expression of ffmpeg that is not 0 for frames of given numbers
///
/// Sums of more than 100 terms are too deep for it; nested in halves, they are not.
fn any_of(indices: &[usize]) -> String {
    match indices {
        [] => "0".to_owned(),
        [index] => format!("eq(n,{index})"),
        several => {
            let (first, second) = several.split_at(several.len() / 2);
            format!("({}+{})", any_of(first), any_of(second))
        }
    }
}

impl FrameSource for FfmpegVideo {
    type Error = VideoError;

    fn frames(
        &mut self,
        max_side_px: usize,
        indices: Option<&[usize]>,
        on_frame: &mut dyn FnMut(Frame) -> ControlFlow<()>,
    ) -> Result<(), VideoError> {
        let mut ffmpeg = self.start(max_side_px, indices)?;
        let (Some(pictures), Some(messages)) = (ffmpeg.stdout.take(), ffmpeg.stderr.take()) else {
            return Ok(());
        };
        let (times, next_time) = channel();
        let listener = thread::spawn(move || listen(messages, &times));
        let mut pictures = BufReader::with_capacity(1 << 20, pictures);
        let passed = pass_frames(&mut pictures, &next_time, indices, on_frame);
        // After a break, the rest is not decoded; at the end this does nothing.
        let stopped = matches!(passed, Ok(Passed { stopped: true, .. }));
        if stopped || passed.is_err() {
            let _ = ffmpeg.kill();
        }
        drop(pictures);
        let message = listener.join().unwrap_or_default();
        let status = ffmpeg.wait();
        let path = || self.path.clone();
        match passed {
            Ok(Passed { count, .. }) if count > 0 || indices.is_some_and(<[_]>::is_empty) => Ok(()),
            Ok(_) if stopped => Ok(()),
            Ok(_) if status.is_ok_and(|status| status.success()) => {
                Err(VideoError::NoVideo { path: path() })
            }
            Ok(_) => Err(VideoError::Damaged {
                path: path(),
                message: last_line(&message, &self.path),
            }),
            Err(source) => Err(VideoError::Read {
                path: path(),
                source,
            }),
        }
    }
}

struct Passed {
    count: usize,
    stopped: bool,
}

/// Passes pictures with their numbers and times, until the stream ends or `on_frame` breaks
///
/// A picture that is cut at the end of the stream is left out.
fn pass_frames(
    pictures: &mut impl BufRead,
    times: &Receiver<f64>,
    indices: Option<&[usize]>,
    on_frame: &mut dyn FnMut(Frame) -> ControlFlow<()>,
) -> io::Result<Passed> {
    let mut count = 0;
    loop {
        let photo = match read_ppm(pictures) {
            Ok(Some(photo)) => photo,
            Ok(None) => break,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof && count > 0 => break,
            Err(error) => return Err(error),
        };
        // The message precedes the picture.
        let Ok(time_s) = times.recv() else {
            break;
        };
        if time_s.is_nan() {
            let reason = "they have no time stamps; convert the video to MP4";
            return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
        }
        let index = match indices {
            Some(indices) => match indices.get(count) {
                Some(&index) => index,
                None => break,
            },
            None => count,
        };
        count += 1;
        let frame = Frame {
            index,
            time_s,
            photo,
        };
        if on_frame(frame).is_break() {
            return Ok(Passed {
                count,
                stopped: true,
            });
        }
    }
    Ok(Passed {
        count,
        stopped: false,
    })
}

/// Sends the times of frames; returns the last other messages
fn listen(messages: impl Read, times: &Sender<f64>) -> String {
    const KEPT: usize = 20;
    let mut others: Vec<String> = Vec::new();
    for line in BufReader::new(messages).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line);
        if let Some(time_s) = time_of(&line) {
            // The receiver is gone if the rest of the video is not needed.
            let _ = times.send(time_s);
        } else if !line.contains("Parsed_showinfo") {
            others.push(line.trim().to_owned());
            if others.len() > KEPT {
                others.remove(0);
            }
        }
    }
    others.join("\n")
}

/// Returns the time of a frame, in s, that a line of `showinfo` reports; NaN if the frame has none
fn time_of(line: &str) -> Option<f64> {
    if !line.contains("Parsed_showinfo") {
        return None;
    }
    let (_, after) = line.split_once("pts_time:")?;
    let text = after.split_whitespace().next()?;
    let time_s: Option<f64> = text.parse().ok();
    Some(
        time_s
            .filter(|time_s| time_s.is_finite())
            .unwrap_or(f64::NAN),
    )
}

/// Returns the input as an argument: names may contain colons or start with a dash
pub(super) fn input(path: &Path) -> OsString {
    let mut input = OsString::from("file:");
    input.push(path);
    input
}

/// Returns the last line of messages, without the path
pub(super) fn last_line(messages: &str, path: &Path) -> String {
    let line = messages.lines().rev().find(|line| !line.trim().is_empty());
    let line = line.unwrap_or("the file is damaged").trim();
    let name = format!("file:{}: ", path.display());
    line.strip_prefix(&name).unwrap_or(line).to_owned()
}

pub(super) fn cannot_start(program: &'static str, source: io::Error) -> VideoError {
    if source.kind() == io::ErrorKind::NotFound {
        VideoError::NoFfmpeg
    } else {
        VideoError::Start { program, source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_from_messages_of_the_filter() {
        let line = "[Parsed_showinfo_3 @ 0x55] n:   2 pts:   1024 pts_time:0.0666667 duration: 512";
        assert_eq!(time_of(line), Some(0.0666667));
        let without = time_of("[Parsed_showinfo_3 @ 0x55] n:   2 pts: NOPTS pts_time:NOPTS");
        assert!(without.is_some_and(f64::is_nan));
        assert_eq!(time_of("[mov] pts_time:3.0"), None);
        let messages = format!("{}\nbroken\n{line}\n", line.replace("0.0666667", "2.5"));
        let (send, receive) = channel();
        assert_eq!(listen(messages.as_bytes(), &send), "broken");
        drop(send);
        let times: Vec<f64> = receive.iter().collect();
        assert_eq!(times, [2.5, 0.0666667]);
    }

    #[test]
    fn messages_do_not_repeat_the_path() {
        let path = Path::new("a b.mp4");
        let message = "[mov] moov atom not found\nfile:a b.mp4: Invalid data found\n\n";
        assert_eq!(last_line(message, path), "Invalid data found");
        assert_eq!(last_line("", path), "the file is damaged");
    }

    #[test]
    fn a_name_is_never_an_option_or_a_protocol() {
        assert_eq!(input(Path::new("-i.mp4")), "file:-i.mp4");
        assert_eq!(input(Path::new("http://x")), "file:http://x");
    }
}
