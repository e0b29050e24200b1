use super::Answer;
use crate::error::Result;
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}
pub(super) fn run(_: &Arguments) -> Result<Answer> {
    Ok(Answer::Yes)
}
