//! Errors and remarks as sentences.

use anyhow::Error;

/// An error and its causes; a cause that the sentence before already told is not repeated.
pub fn in_words(error: &Error) -> String {
    let mut sentences: Vec<String> = Vec::new();
    for cause in error.chain().map(ToString::to_string) {
        if !sentences.last().is_some_and(|told| told.contains(&cause)) {
            sentences.push(cause);
        }
    }
    sentences.join(": ")
}

/// That a share of a lamp's light is missing which panes and coats mirror; `key` is the lamp's.
pub fn mirrored_words(key: &str, share: f32) -> String {
    format!(
        "panes of glass and smooth coats mirror {:.0} % of the light of `{key}` onto other surfaces, which is missing",
        100.0 * share
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_that_was_told_is_not_told_again() {
        let error = Error::msg("no such file").context("cannot read a: no such file").context("cannot open a");
        assert_eq!(in_words(&error), "cannot open a: cannot read a: no such file");
    }
}
