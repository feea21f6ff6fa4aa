//! Chromium without a window, steered by its DevTools protocol (https://chromedevtools.github.io/devtools-protocol).

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};
use volpm::image::{self, Image};

/// The browser: `$CHROME`, or the first that is on the path.
pub fn find() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("CHROME").filter(|name| !name.is_empty()) {
        return Some(named.into());
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file())
}

/// A running browser with one page.
pub struct Browser {
    child: Child,
    /// Holds what the browser keeps.
    folder: tempfile::TempDir,
    socket: WebSocket<TcpStream>,
    session: Option<String>,
    sent: u64,
    /// What pages logged as errors or warnings, and what they threw.
    pub complaints: Vec<String>,
    /// What pages asked for.
    pub requests: Vec<String>,
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Told to close, it ends its own processes, too.
        let _ = self.socket.send(Message::text(json!({ "id": 0, "method": "Browser.close" }).to_string()));
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(5) && !matches!(self.child.try_wait(), Ok(Some(_))) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Browser {
    /// Starts it. Panics if there is none.
    pub fn start() -> Browser {
        let program = find().expect("install chromium, or name a browser in CHROME");
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(&program)
            .args(["--headless", "--remote-debugging-port=0", "--disable-gpu", "--hide-scrollbars"])
            .args(["--no-first-run", "--disable-extensions", "--disable-background-networking"])
            // The page is ours, and the sandbox is not to be had in containers and by root.
            .args(["--no-sandbox", "--disable-dev-shm-usage", "--force-device-scale-factor=1"])
            .arg(format!("--user-data-dir={}", folder.path().display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let url = lines.find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_string));
        let url = url.expect("the browser said where it listens");
        // It goes on writing there.
        std::thread::spawn(move || lines.for_each(drop));
        let address = url.trim_start_matches("ws://").split('/').next().unwrap().to_string();
        let stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let (socket, _) = tungstenite::client(url.as_str(), stream).unwrap();
        let mut browser =
            Browser { child, folder, socket, session: None, sent: 0, complaints: Vec::new(), requests: Vec::new() };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached =
            browser.call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_string);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        // Keys go to the page although no window has the focus.
        browser.call("Emulation.setFocusEmulationEnabled", json!({ "enabled": true }));
        browser
    }

    /// Calls a method of the protocol and returns its result.
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.sent += 1;
        let mut message = json!({ "id": self.sent, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).unwrap();
        loop {
            let message = self.receive();
            if message["id"] == self.sent {
                assert!(message["error"].is_null(), "{method}: {}", message["error"]);
                return message["result"].clone();
            }
        }
    }

    /// The next message; what events tell is kept.
    fn receive(&mut self) -> Value {
        let message: Value = loop {
            if let Message::Text(text) = self.socket.read().expect("the browser answers") {
                break serde_json::from_str(&text).unwrap();
            }
        };
        let told = &message["params"];
        match message["method"].as_str() {
            Some("Runtime.exceptionThrown") => self.complaints.push(told["exceptionDetails"].to_string()),
            Some("Runtime.consoleAPICalled") if told["type"] != "log" => self.complaints.push(told["args"].to_string()),
            Some("Log.entryAdded") => self.complaints.push(told["entry"].to_string()),
            Some("Network.loadingFailed") if told["canceled"] != true => self.complaints.push(told.to_string()),
            Some("Network.requestWillBeSent") => {
                self.requests.extend(told["request"]["url"].as_str().map(str::to_string));
            }
            _ => {}
        }
        message
    }

    /// Opens a file in a window of the given width and height, and waits until it is loaded.
    pub fn open(&mut self, file: &Path, [width, height]: [u32; 2]) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
        let path = fs::canonicalize(file).unwrap();
        let opened = self.call("Page.navigate", json!({ "url": format!("file://{}", path.display()) }));
        assert!(opened["errorText"].is_null(), "{opened}");
        while self.receive()["method"] != "Page.loadEventFired" {}
    }

    /// The value of an expression; a promise is waited for.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let result = self.call("Runtime.evaluate", parameters);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {}", result["exceptionDetails"]);
        result["result"]["value"].clone()
    }

    /// Presses and releases a key: a letter, `Home`, `End`, `ArrowLeft`, …
    pub fn key(&mut self, key: &str) {
        let codes = HashMap::from([("End", 35), ("Home", 36), ("ArrowLeft", 37), ("ArrowRight", 39)]);
        let code = codes.get(key).copied().unwrap_or_else(|| i64::from(key.to_ascii_uppercase().as_bytes()[0]));
        let text = if key.len() == 1 { key } else { "" };
        for kind in ["keyDown", "keyUp"] {
            let event = json!({ "type": kind, "key": key, "text": text, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Where an element is in the window: left, top, width, height.
    fn place(&mut self, selector: &str) -> [f64; 4] {
        let place = self.evaluate(&format!(
            "(() => {{ const r = document.querySelector({}).getBoundingClientRect(); return [r.x, r.y, r.width, r.height] }})()",
            json!(selector)
        ));
        [0, 1, 2, 3].map(|i| place[i].as_f64().unwrap())
    }

    /// Clicks into the middle of an element.
    pub fn click(&mut self, selector: &str) {
        let [x, y, width, height] = self.place(selector);
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({
                "type": kind, "x": x + 0.5 * width, "y": y + 0.5 * height, "button": "left", "clickCount": 1,
            });
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// What an element in view looks like.
    pub fn picture(&mut self, selector: &str) -> Image {
        // Pictures have come, and what was changed has been drawn.
        self.evaluate(&format!(
            "Promise.all([...document.querySelectorAll({})].filter(i => i.src).map(i => i.decode()))
                .then(() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1)))))",
            json!(format!("{selector} img"))
        ));
        let [x, y, width, height] = self.place(selector);
        // Places in a window become places on the page.
        let scrolled = self.evaluate("[scrollX, scrollY]");
        let [x, y] = [x + scrolled[0].as_f64().unwrap(), y + scrolled[1].as_f64().unwrap()];
        let clip = json!({ "x": x.round(), "y": y.round(), "width": width, "height": height, "scale": 1 });
        let path = self.folder.path().join("element.png");
        self.capture(&json!({ "clip": clip }), &path);
        image::read(path).unwrap().image
    }

    /// Writes a picture of the whole page.
    pub fn screenshot(&mut self, path: &Path) {
        self.capture(&json!({ "captureBeyondViewport": true }), path);
    }

    fn capture(&mut self, options: &Value, path: &Path) {
        let shot = self.call("Page.captureScreenshot", options.clone());
        fs::write(path, base64(shot["data"].as_str().unwrap())).unwrap();
    }

    /// Whether pages are to be dark.
    pub fn set_dark(&mut self, dark: bool) {
        let value = if dark { "dark" } else { "light" };
        let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": value }] });
        self.call("Emulation.setEmulatedMedia", features);
    }

    /// Whether pages may run scripts.
    pub fn set_script(&mut self, runs: bool) {
        self.call("Emulation.setScriptExecutionDisabled", json!({ "value": !runs }));
    }
}

/// The bytes that a text stands for (RFC 4648).
fn base64(text: &str) -> Vec<u8> {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut bytes, mut bits, mut count) = (Vec::with_capacity(text.len() * 3 / 4), 0u32, 0);
    for letter in text.bytes().filter(|letter| *letter != b'=') {
        bits = bits << 6 | LETTERS.iter().position(|known| *known == letter).expect("base64") as u32;
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    bytes
}
