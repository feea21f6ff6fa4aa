//! `volpm completions`.

use clap::builder::PossibleValuesParser;
use clap::{Arg, Args, Command, CommandFactory};
use clap_complete::Shell;

use crate::Result;
use crate::scene::manual;

#[derive(Args)]
#[command(
    after_help = "bash: volpm completions bash > ~/.local/share/bash-completion/completions/volpm\nzsh:  volpm completions zsh > DIR/_volpm, for a DIR of $fpath\nfish: volpm completions fish > ~/.config/fish/completions/volpm.fish"
)]
pub struct Arguments {
    /// The shell.
    shell: Shell,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command(), "volpm", &mut script);
    super::print(&String::from_utf8_lossy(&script))
}

/// The program's arguments, with the keys of scene files for `help`.
fn command() -> Command {
    let program = super::Arguments::command();
    let commands = program.get_subcommands().map(|command| command.get_name().to_string());
    let mut asked: Vec<String> = commands.chain(manual::paths()).collect();
    asked.sort_unstable();
    asked.dedup();
    let asked = Arg::new("KEY").value_parser(PossibleValuesParser::new(asked));
    let help = Command::new("help").about("Help of a command, or the manual of a key of scene files").arg(asked);
    program.disable_help_subcommand(true).subcommand(help)
}
