//! Progress on standard error: a bar on a terminal, plain lines elsewhere.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pirouette::pipeline::Event;
use pirouette_files::job::JobEvent;

/// Shows the progress of a running job
#[derive(Debug)]
pub enum Progress {
    /// One bar, reset by each stage
    Bar(ProgressBar),
    /// One line per stage
    Lines,
    /// No output
    Quiet,
}

impl Progress {
    /// Selects the display that suits standard error
    pub fn new(quiet: bool) -> Self {
        if quiet {
            Progress::Quiet
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{prefix:>10} {wide_bar} {pos}/{len}");
            if let Ok(style) = style {
                bar.set_style(style);
            }
            Progress::Bar(bar)
        } else {
            Progress::Lines
        }
    }

    /// Shows one event
    pub fn show(&self, event: &Event) {
        match (self, event) {
            (Progress::Quiet, _) => {}
            (Progress::Bar(bar), Event::StageStarted { stage, step_count }) => {
                bar.set_prefix(stage.name());
                bar.set_length(*step_count as u64);
                bar.set_position(0);
            }
            (Progress::Bar(bar), Event::StepDone { .. }) => bar.inc(1),
            (Progress::Lines, Event::StageDone { stage, seconds }) => {
                eprintln!("{}: {seconds:.2} s", stage.name());
            }
            (_, Event::Warning(warning)) => self.print_line(&format!("warning: {warning}")),
            _ => {}
        }
    }

    /// Shows one event of a job
    pub fn show_job(&self, event: &JobEvent) {
        match event {
            JobEvent::Pipeline(event) => self.show(event),
            JobEvent::LoadWarning(warning) => self.print_line(&format!("warning: {warning}")),
            JobEvent::ViewFailed(failed) => self.print_line(&format!("warning: {failed}")),
            JobEvent::CardFound { view, card } => self.print_line(&format!(
                "scale: {:.3} mm per px from the card in view {view}, tilted by {:.0} degrees",
                card.mm_per_px, card.tilt_degrees
            )),
            JobEvent::CardNotNeeded => {
                self.print_line("warning: scan.json provides the stature; --scale card is ignored");
            }
            _ => {}
        }
    }

    /// Shows the share of a task that is done, from 0 to 1
    pub fn share(&self, task: &'static str, share: f64) {
        if let Progress::Bar(bar) = self {
            bar.set_prefix(task);
            bar.set_length(100);
            bar.set_position((100.0 * share) as u64);
        }
    }

    /// Shows how many jobs of a study are done
    pub fn step(&self, done: usize, total: usize, text: &str) {
        if let Progress::Bar(bar) = self {
            bar.set_prefix("study");
            bar.set_length(total as u64);
            bar.set_position(done as u64);
        }
        self.print_line(&format!("{done}/{total}: {text}"));
    }

    /// Prints a line without disrupting the bar
    pub fn print_line(&self, line: &str) {
        match self {
            Progress::Bar(bar) => bar.suspend(|| eprintln!("{line}")),
            Progress::Lines => eprintln!("{line}"),
            Progress::Quiet => {}
        }
    }

    /// Removes the bar
    pub fn finish(&self) {
        if let Progress::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}
