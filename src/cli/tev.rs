//! Images sent to the viewer tev while they are made (<https://github.com/Tom94/tev>).

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use crate::image::Image;
use crate::{Error, Result};

/// How long the viewer may take to answer, or to take data.
const PATIENCE: Duration = Duration::from_secs(5);
/// Pixels sent at once.
const CHUNK: usize = 1 << 20;

/// An image in a viewer.
pub struct Viewer {
    client: TevClient,
    name: String,
}

impl Viewer {
    /// A black image of this name in the viewer that listens at `address`, `HOST:PORT`.
    pub fn new(address: &str, name: &str, (width, height): (u32, u32)) -> Result<Self> {
        let connected = connect(address).and_then(|socket| {
            let mut client = TevClient::wrap(socket);
            // Names end at a zero byte.
            let name = name.replace('\0', "");
            let channel_names = &["R", "G", "B"];
            client.send(PacketCreateImage { image_name: &name, grab_focus: true, width, height, channel_names })?;
            Ok(Viewer { client, name })
        });
        connected.map_err(|error| {
            Error::output(
                address,
                format!("no tev viewer takes images there ({error}); start tev first, and give its HOST:PORT, by default 127.0.0.1:14158"),
            )
        })
    }

    /// Shows the image.
    pub fn show(&mut self, image: &Image) -> io::Result<()> {
        let rows = (CHUNK / image.width.max(1)).max(1);
        for (index, pixels) in image.pixels.chunks(rows * image.width.max(1)).enumerate() {
            self.client.send(PacketUpdateImage {
                image_name: &self.name,
                grab_focus: false,
                channel_names: &["R", "G", "B"],
                channel_offsets: &[0, 1, 2],
                channel_strides: &[3, 3, 3],
                x: 0,
                y: (index * rows) as u32,
                width: image.width as u32,
                height: (pixels.len() / image.width) as u32,
                data: pixels.as_flattened(),
            })?;
        }
        Ok(())
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut failure = io::Error::new(io::ErrorKind::AddrNotAvailable, "the host has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(socket) => {
                socket.set_write_timeout(Some(PATIENCE))?;
                return Ok(socket);
            }
            Err(error) => failure = error,
        }
    }
    Err(failure)
}
