//! The `pirouette` command: silhouettes, body and measurements from photos of a turning person.

mod arap_command;
mod args;
mod avatar_command;
mod check_command;
mod compare_command;
mod demo_command;
mod eval_command;
mod keypoints_command;
mod measure_command;
mod models_command;
mod open;
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
            "error: this program requires a processor with AVX2; \
             build it with RUSTFLAGS=\"-C target-cpu=native\" on this machine"
        );
        return ExitCode::FAILURE;
    }
    let cli = Cli::parse();
    let output = Output::new(cli.json, cli.quiet);
    match run(&cli, output) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The only place where errors are printed, with the complete chain in one line.
            let message = one_line(&error);
            eprintln!("error: {message}");
            output.failed(&message);
            ExitCode::FAILURE
        }
    }
}

/// Returns whether the processor lacks the vector instructions that the program was built with
fn processor_is_too_old() -> bool {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    {
        use std::arch::x86_64::{__cpuid, __cpuid_count};
        // AVX2 is bit 5 of EBX in leaf 7, which older processors do not have.
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
    // Runs on a thread of the pool: the main thread would mostly wait for it, and keep additional memory allocated.
    rayon::scope(|_| run_command(cli, output, &cancel))
}

fn run_command(cli: &Cli, output: Output, cancel: &CancelToken) -> Result<()> {
    let scan = |args, goal| scan_command::run(args, goal, output, cli.quiet, cancel);
    match &cli.command {
        Command::Scan(args) => scan(args, Goal::Measure),
        Command::Segment(args) => scan(args, Goal::Segment),
        Command::Normalize(args) => scan(args, Goal::Normalize),
        Command::Reconstruct(args) => scan(args, Goal::Reconstruct),
        Command::Measure(args) => measure_command::run(args, output, cli.quiet, cancel),
        Command::Check(args) => check_command::run(args, output, cli.quiet, cancel),
        Command::Keypoints(args) => keypoints_command::run(args, output, cli.quiet, cancel),
        Command::Demo(args) => demo_command::run(args, output, cli.quiet, cancel),
        Command::Compare(args) => compare_command::run(args, output),
        Command::Size(args) => size_command::run(args, output),
        Command::Avatar(args) => avatar_command::run(args, output),
        Command::Arap(args) => arap_command::run(args, output),
        Command::Eval(args) => eval_command::run(args, output, cli.quiet, cancel),
        Command::Models(args) => models_command::run(args, output, cancel),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "pirouette", &mut script);
            output::print(&script)
        }
    }
}

/// Formats an error with its causes; skips causes that are already part of the message
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

/// Returns a token that Ctrl-C, a termination request or a closed terminal cancels; files being written are completed
fn cancel_on_interrupt() -> Result<CancelToken> {
    let cancel = CancelToken::default();
    let handler = cancel.clone();
    ctrlc::set_handler(move || handler.cancel()).context("cannot handle Ctrl-C")?;
    Ok(cancel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::anyhow;

    #[test]
    fn repeated_causes_are_printed_once() {
        let error = anyhow!("no room").context("a.png: no room").context("out");
        assert_eq!(one_line(&error), "out: a.png: no room");
    }
}
