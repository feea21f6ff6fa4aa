//! `--force`.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::render::Forced;

/// What a render is to have though its plan leaves it out.
#[derive(Args, Clone)]
pub struct Force {
    /// Builds what the plan leaves out, by its name in `volpm plan`, to see what leaving it out saves; repeatable. The picture shows the same light.
    #[arg(id = "force", long = "force", value_name = "NAME", value_parser = names(), hide_possible_values = true, conflicts_with = "memory")]
    pub forced: Vec<Forced>,
}

fn names() -> impl TypedValueParser<Value = Forced> {
    let names = PossibleValuesParser::new(Forced::ALL.map(Forced::name));
    names.try_map(|name| Forced::of_name(&name).ok_or("cannot be forced"))
}
