//! Encoding by the program `ffmpeg`.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::{self, JoinHandle};

use pirouette::scan::Photo;

use super::VideoError;
use super::ffmpeg::{cannot_start, input, last_line};

/// Writes a video (H.264) picture by picture
///
/// The file gets its name when the video is [finished](VideoWriter::finish): without that, none is left.
#[derive(Debug)]
pub struct VideoWriter {
    path: PathBuf,
    partial: PathBuf,
    ffmpeg: Child,
    pictures: Option<ChildStdin>,
    messages: Option<JoinHandle<String>>,
    size_px: (usize, usize),
}

impl VideoWriter {
    /// Starts a video with even numbers of columns and rows, at a rate in frames and in bits per second
    ///
    /// The format is that of the file's extension.
    ///
    /// # Errors
    /// When `ffmpeg` cannot be started.
    pub fn create(
        path: &Path,
        size_px: (usize, usize),
        frames_per_s: f64,
        bits_per_s: u32,
    ) -> Result<Self, VideoError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let partial = path.with_file_name(format!(".partial-{name}"));
        let mut command = Command::new("ffmpeg");
        command
            .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo"])
            .args([
                "-pix_fmt",
                "rgb24",
                "-s",
                &format!("{}x{}", size_px.0, size_px.1),
            ])
            .args(["-r", &frames_per_s.to_string(), "-i", "pipe:0"])
            .args([
                "-c:v", "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p",
            ])
            .args(["-b:v", &bits_per_s.to_string()])
            .arg(input(&partial))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut ffmpeg = command.spawn().map_err(|e| cannot_start("ffmpeg", e))?;
        let messages = ffmpeg.stderr.take().map(|mut messages| {
            thread::spawn(move || {
                let mut text = Vec::new();
                let _ = messages.read_to_end(&mut text);
                String::from_utf8_lossy(&text).into_owned()
            })
        });
        Ok(Self {
            path: path.to_owned(),
            partial,
            pictures: ffmpeg.stdin.take(),
            ffmpeg,
            messages,
            size_px,
        })
    }

    /// Adds a picture
    ///
    /// # Errors
    /// When it has another size, or `ffmpeg` has failed.
    pub fn write(&mut self, photo: &Photo) -> Result<(), VideoError> {
        let sent = match &mut self.pictures {
            Some(pictures) if (photo.width(), photo.height()) == self.size_px => {
                pictures.write_all(photo.as_slice().as_flattened()).is_ok()
            }
            _ => false,
        };
        if sent { Ok(()) } else { Err(self.failure()) }
    }

    /// Completes the file
    ///
    /// # Errors
    /// When `ffmpeg` has failed, or the file cannot be renamed.
    pub fn finish(mut self) -> Result<(), VideoError> {
        drop(self.pictures.take());
        let encoded = self.ffmpeg.wait().is_ok_and(|status| status.success());
        if encoded && fs::rename(&self.partial, &self.path).is_ok() {
            Ok(())
        } else {
            Err(self.failure())
        }
    }

    /// Ends `ffmpeg`, and returns its last message
    fn failure(&mut self) -> VideoError {
        drop(self.pictures.take());
        let _ = self.ffmpeg.wait();
        let messages = self.messages.take().and_then(|m| m.join().ok());
        let message = match messages.as_deref() {
            Some(text) if !text.trim().is_empty() => last_line(text, &self.partial),
            _ => "a picture has another size, or the file cannot be written".to_owned(),
        };
        VideoError::Write {
            path: self.path.clone(),
            message,
        }
    }
}

impl Drop for VideoWriter {
    fn drop(&mut self) {
        if self.pictures.take().is_some() {
            let _ = self.ffmpeg.kill();
        }
        let _ = self.ffmpeg.wait();
        // Renamed if finished
        let _ = fs::remove_file(&self.partial);
    }
}
