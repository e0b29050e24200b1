//! `adj devices`: lists the graphics devices of the machine.

use clap::Args;
use indicatif::HumanBytes;
use serde_json::json;

use super::{Answer, print_result};
use adjsplat::error::Result;
use adjsplat::splat::gpu::adapter::{AdapterFacts, adapters};

/// List the graphics devices that adj render can use, best first
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  adj devices\nExit code 1 if there is none. WGPU_BACKEND=vulkan (metal, dx12) lists those of one kind."
)]
pub(super) struct Arguments {
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    #[cfg(unix)]
    let adapters = super::complaints::each_once(adapters);
    #[cfg(not(unix))]
    let adapters = adapters();
    if arguments.json {
        let rows: Vec<_> = adapters.iter().map(row).collect();
        print_result(&format!("{:#}", json!({ "devices": rows })));
    } else if adapters.is_empty() {
        print_result("no graphics device: adj render draws on the processor");
    } else {
        for facts in &adapters {
            let floats = if facts.blends_float32 { "32 bits" } else { "16 bits" };
            let clock = if facts.has_clock { "" } else { ", no clock" };
            print_result(&format!(
                "{}: {} by {} ({}), bindings up to {}, quads accumulate in {floats}{clock}",
                facts.name,
                facts.kind,
                facts.backend,
                facts.driver,
                HumanBytes(facts.most_binding),
            ));
        }
    }
    Ok(if adapters.is_empty() { Answer::No } else { Answer::Yes })
}

fn row(facts: &AdapterFacts) -> serde_json::Value {
    json!({
        "name": facts.name,
        "kind": facts.kind,
        "backend": facts.backend,
        "driver": facts.driver,
        "most_binding_bytes": facts.most_binding,
        "most_buffer_bytes": facts.most_buffer,
        "blends_float32": facts.blends_float32,
        "has_clock": facts.has_clock,
    })
}
