//! `adj serve`: the viewer's page and some files, for a browser on this machine.

use std::path::PathBuf;

use clap::Args;

use super::Answer;
use adjsplat::error::{Error, Result};

/// Show files in a browser on this machine: serves the viewer's page and prints the link
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  adj serve head.adj\nThe page fetches only the parts of a file that it draws. It builds volumes that are one file. It needs a browser with WebGPU.\nOther machines cannot reach it: for them, put the page's folder on a server, and the files into that\nfolder."
)]
pub(super) struct Arguments {
    /// .adj files, or volumes of one file each
    #[arg(value_name = "FILE", required = true)]
    input: Vec<PathBuf>,
    /// The page's folder, with index.html [default: the folder page beside the program or one above]
    #[arg(long, value_name = "DIR")]
    page: Option<PathBuf>,
    /// The port; 0 takes one that is free
    #[arg(long, default_value_t = 0)]
    port: u16,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    for path in &arguments.input {
        std::fs::metadata(path).map_err(Error::io("open", path))?;
    }
    serve(arguments)
}

#[cfg(not(feature = "serve"))]
fn serve(_: &Arguments) -> Result<Answer> {
    Err(Error::input("adj serve", "was left out of this program; build it with --features serve"))
}

#[cfg(feature = "serve")]
fn serve(arguments: &Arguments) -> Result<Answer> {
    server::run(arguments)
}

#[cfg(feature = "serve")]
mod server {
    use std::collections::BTreeMap;
    use std::net::{Ipv4Addr, SocketAddr};
    use std::path::{Path, PathBuf};
    use std::sync::Arc;

    use axum::Router;
    use axum::extract::{Path as Segment, Request, State};
    use axum::http::header::{CACHE_CONTROL, HOST, HeaderName, HeaderValue, RANGE, X_CONTENT_TYPE_OPTIONS};
    use axum::http::{StatusCode, Uri};
    use axum::middleware::{Next, from_fn};
    use axum::response::{IntoResponse as _, Response};
    use axum::routing::get;
    use tower::ServiceExt as _;
    use tower_http::services::{ServeDir, ServeFile};

    use super::Arguments;
    use crate::info::is_adj;
    use crate::{Answer, print_note, print_result};
    use adjsplat::Model;
    use adjsplat::collection::Collection;
    use adjsplat::error::{Error, Result};
    use adjsplat_readers::{OpenOptions, open};

    type Files = Arc<BTreeMap<String, PathBuf>>;

    pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
        let page = page(arguments.page.as_deref())?;
        let (names, files) = files(&arguments.input)?;
        let files = Arc::new(files);
        let serving = async {
            let address = SocketAddr::from((Ipv4Addr::LOCALHOST, arguments.port));
            let cannot = |fault| Error::input("--port", format!("{}: {fault}", arguments.port));
            let listener = tokio::net::TcpListener::bind(address).await.map_err(cannot)?;
            let address = listener.local_addr().map_err(cannot)?;
            for name in &names {
                print_result(&format!("http://{address}/?file=files/{}", encoded(&encoded(name))));
            }
            print_note("Ctrl-C ends");
            axum::serve(listener, router(&page, files.clone())).await.map_err(cannot)
        };
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
        let runtime = runtime.map_err(|fault| Error::input("adj serve", format!("cannot begin: {fault}")))?;
        runtime.block_on(serving).map(|()| Answer::Yes)
    }

    /// Returns the folder of the page.
    fn page(given: Option<&Path>) -> Result<PathBuf> {
        let beside = || {
            let program = std::env::current_exe().ok()?;
            let folder = program.parent()?.to_owned();
            Some([folder.join("page"), folder.join("../page")])
        };
        let places = match given {
            Some(folder) => vec![folder.to_owned()],
            None => beside().map(Vec::from).unwrap_or_default(),
        };
        let found = places.iter().find(|folder| folder.join("index.html").is_file());
        found.cloned().ok_or_else(|| {
            let named = places.first().map_or_else(|| "page".into(), |folder| folder.display().to_string());
            Error::input(
                named,
                "has no index.html; build the page with src/view/page/build, and give its folder by --page",
            )
        })
    }

    /// Checks that the page can show a file.
    fn check(path: &Path) -> Result<()> {
        let refused = |why: &str| Err(Error::input(path.display().to_string(), why));
        if Collection::is_at(path) {
            return refused("is a collection, which the page does not read; adj join makes one file of it");
        }
        if path.is_dir() {
            return refused("is a folder; give one file");
        }
        if is_adj(path)? {
            return Model::open(path).map(drop);
        }
        let volume = open(path, &OpenOptions::new())?;
        match volume.data_files().iter().all(|file| file == path) {
            true => Ok(()),
            false => refused("has its samples in other files; build an .adj file of it, and serve that"),
        }
    }

    /// Returns the names under which files are served, in their order, and the files by these names.
    fn files(paths: &[PathBuf]) -> Result<(Vec<String>, BTreeMap<String, PathBuf>)> {
        let (mut names, mut files) = (Vec::new(), BTreeMap::new());
        for path in paths {
            check(path)?;
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            if files.insert(name.clone(), path.clone()).is_some() {
                return Err(Error::input(name, "is the name of two files; rename one"));
            }
            names.push(name);
        }
        Ok((names, files))
    }

    fn router(page: &Path, files: Files) -> Router {
        Router::new()
            .route("/files/{name}", get(file))
            .with_state(files)
            .fallback_service(ServeDir::new(page))
            .layer(from_fn(guard))
    }

    async fn file(State(files): State<Files>, Segment(name): Segment<String>, mut request: Request) -> Response {
        let Some(path) = files.get(&name) else { return StatusCode::NOT_FOUND.into_response() };
        // A pipe in place of the file would never answer.
        let Some(facts) = tokio::fs::metadata(path).await.ok().filter(|facts| facts.is_file()) else {
            return StatusCode::NOT_FOUND.into_response();
        };
        // The last bytes of a shorter file are all of it.
        let last = request.headers().get(RANGE).and_then(|range| range.to_str().ok()?.strip_prefix("bytes=-"));
        if last.and_then(|last| last.parse::<u64>().ok()).is_some_and(|last| last >= facts.len()) {
            request.headers_mut().remove(RANGE);
        }
        *request.uri_mut() = Uri::from_static("/");
        match ServeFile::new(path).oneshot(request).await {
            Ok(response) => response.into_response(),
            Err(never) => match never {},
        }
    }

    /// Refuses requests that another page could make through a name of its own that leads to this machine.
    async fn guard(request: Request, next: Next) -> Response {
        // No file has such a name; the system's fault for it is another one than of a file that is absent.
        let is_too_long = request.uri().path().len() > 255;
        let host = request.headers().get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
        let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
        let is_here = ["127.0.0.1", "localhost"].iter().any(|here| here.eq_ignore_ascii_case(name));
        let mut response = match is_here {
            true => next.run(request).await,
            false => (StatusCode::FORBIDDEN, "open this page as http://127.0.0.1 or http://localhost").into_response(),
        };
        if is_too_long && response.status() == StatusCode::INTERNAL_SERVER_ERROR {
            response = StatusCode::NOT_FOUND.into_response();
        }
        let headers = response.headers_mut();
        headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        let only_here = HeaderName::from_static("cross-origin-resource-policy");
        headers.insert(only_here, HeaderValue::from_static("same-origin"));
        response
    }

    /// Writes a name so that it may stand in an address; an address in a link is written so once more.
    fn encoded(name: &str) -> String {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte);
        name.bytes()
            .map(|byte| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
            .collect()
    }
}
