//! The pirouette command: photos of a turning person in, silhouettes, body and measurements out.

mod arap_command;
mod args;
mod avatar_command;
mod demo_command;
mod eval_command;
mod output;
mod progress;
mod scan_command;
mod size_command;

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{CommandFactory, Parser};
use pirouette::pipeline::{CancelToken, Goal};

use args::{Cli, Command};
use output::Output;

fn main() -> ExitCode {
    if processor_is_too_old() {
        eprintln!(
            "error: this program was built for processors with AVX2, which this one lacks; \
             build it with RUSTFLAGS=\"-C target-cpu=native\" on this machine"
        );
        return ExitCode::FAILURE;
    }
    let cli = Cli::parse();
    let output = Output::new(cli.json, cli.quiet);
    match run(&cli, output) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The one place where errors are printed, with the whole chain in one line.
            let message = one_line(&error);
            eprintln!("error: {message}");
            output.failed(&message);
            ExitCode::FAILURE
        }
    }
}

/// Whether the vector instructions that the program was built with are missing
fn processor_is_too_old() -> bool {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    {
        use std::arch::x86_64::{__cpuid, __cpuid_count};
        // AVX2 is bit 5 of EBX in leaf 7, which older processors do not have at all.
        __cpuid(0).eax < 7 || __cpuid_count(7, 0).ebx & (1 << 5) == 0
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "avx2")))]
    false
}

fn run(cli: &Cli, output: Output) -> Result<()> {
    if let Some(jobs) = cli.jobs {
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(jobs))
            .build_global()
            .context("cannot start the threads")?;
    }
    let cancel = cancel_on_interrupt()?;
    // On one of the threads that do the parallel work: the main thread would wait for them most of the time, and hold on to
    // memory of its own.
    rayon::scope(|_| run_command(cli, output, &cancel))
}

fn run_command(cli: &Cli, output: Output, cancel: &CancelToken) -> Result<()> {
    let scan = |args, goal| scan_command::run(args, goal, output, cli.quiet, cancel);
    match &cli.command {
        Command::Scan(args) => scan(args, Goal::Measure),
        Command::Segment(args) => scan(args, Goal::Segment),
        Command::Normalize(args) => scan(args, Goal::Normalize),
        Command::Reconstruct(args) => scan(args, Goal::Reconstruct),
        Command::Measure(args) => scan(args, Goal::Measure),
        Command::Demo(args) => demo_command::run(args, output, cli.quiet, cancel),
        Command::Size(args) => size_command::run(args, output),
        Command::Avatar(args) => avatar_command::run(args, output),
        Command::Arap(args) => arap_command::run(args, output),
        Command::Eval(args) => eval_command::run(args, output, cli.quiet, cancel),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "pirouette", &mut script);
            output::print(&script)
        }
    }
}

/// An error with its causes; those that a message already tells are not told twice
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if line.contains(&cause) {
            continue;
        }
        if !line.is_empty() {
            line.push_str(": ");
        }
        line.push_str(&cause);
    }
    line.replace('\n', " ")
}

/// A request to stop that Ctrl-C makes, or a closed terminal; what is being written is written to its end
fn cancel_on_interrupt() -> Result<CancelToken> {
    let cancel = CancelToken::default();
    let handler = cancel.clone();
    ctrlc::set_handler(move || handler.cancel()).context("cannot listen to Ctrl-C")?;
    Ok(cancel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::anyhow;

    #[test]
    fn causes_are_told_once() {
        let error = anyhow!("no room").context("a.png: no room").context("out");
        assert_eq!(one_line(&error), "out: a.png: no room");
    }
}
