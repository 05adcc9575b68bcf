//! The address of the script that runs the module, which the worker loads too.

/// The first address in the text of an error's stack. An error that the module makes is made by the script's
/// own function, so this is the script.
pub(super) fn address(stack: &str) -> Option<&str> {
    let colon = stack.find("://")?;
    // Browsers write `at name (ADDRESS:LINE:COLUMN)` or `name@ADDRESS:LINE:COLUMN`.
    let is_of_scheme = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    let begin = stack[..colon].rfind(|c| !is_of_scheme(c)).map_or(0, |before| before + 1);
    let end = stack[colon..].find(|c: char| c.is_whitespace() || c == ')');
    let mut address = &stack[begin..end.map_or(stack.len(), |end| colon + end)];
    for _ in 0..2 {
        let (rest, number) = address.rsplit_once(':')?;
        if !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) {
            address = rest;
        }
    }
    (begin < colon).then_some(address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_script_is_found_in_the_stacks_of_browsers() {
        let chrome = "Error\n    at imports.wbg.__wbg_new_8a (http://localhost:8000/package/app.js:20:19)\n \
                      at app.wasm.<anonymous> (wasm://wasm/02ae:wasm-function[9]:0x12)";
        assert_eq!(address(chrome), Some("http://localhost:8000/package/app.js"));
        let firefox =
            "__wbg_new_8a@https://a.b/app.js?v=2:11:5\n@https://a.b/app_bg.wasm:wasm-function[9]:0x12";
        assert_eq!(address(firefox), Some("https://a.b/app.js?v=2"));
        assert_eq!(address("a@tauri+x://localhost/app.js:1:2"), Some("tauri+x://localhost/app.js"));
        assert_eq!(address("http://localhost:8000/app.js"), Some("http://localhost:8000/app.js"));
        for none in ["", "Error", "://", "Error\n    at <anonymous>:1:7"] {
            assert_eq!(address(none), None, "{none}");
        }
    }
}
