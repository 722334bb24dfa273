//! Cells of text in tables of comma-separated values.

/// A cell as RFC 4180 quotes it. One that a spreadsheet would take for a formula gets an apostrophe before it, which spreadsheets take for
/// "this is text".
pub fn text_cell(text: &str) -> String {
    let text = if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { format!("'{text}") } else { text.into() };
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stay_one_field_and_no_formula() {
        let cases = [
            ("Desk", "Desk"),
            ("a, \"b\"", "\"a, \"\"b\"\"\""),
            ("=1+1", "'=1+1"),
            ("+x", "'+x"),
            ("-x", "'-x"),
            ("@x", "'@x"),
            ("=a,b", "\"'=a,b\""),
            ("1-2", "1-2"),
        ];
        for (text, cell) in cases {
            assert_eq!(text_cell(text), cell);
        }
    }
}
