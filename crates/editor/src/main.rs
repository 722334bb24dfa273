//! The binary: everything is in the library, where tests can drive it.

use std::process::ExitCode;

fn main() -> ExitCode {
    clerestory::cli::run(std::env::args_os(), &mut std::io::stdout(), &mut std::io::stderr())
}
