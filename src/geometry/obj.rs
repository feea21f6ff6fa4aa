//! Wavefront OBJ files, plain or compressed by gzip: vertices, texture coordinates, normals and faces; the
//! rest is skipped.
//!
//! The format is read here and not by `tobj`, which tests compare it with: `tobj` 4.0.5 cuts concave
//! polygons into fans that overlap, names no lines in its errors, and computes places of hostile
//! indices in arithmetic that overflows.

use super::Mesh;
use super::mesh::{MAX_TRIANGLES, Parts};
use crate::math::{DVec2, DVec3, Vec3};
use crate::{Error, Result};
use glam::Vec2;
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Larger files are refused, as are compressed ones that unpack to more.
const MAX_BYTES: u64 = 16 << 30;
/// Polygons that are not convex are cut in quadratic time: those with more corners are refused.
const MAX_CONCAVE: usize = 5000;
/// In a corner: the face does not say.
const ABSENT: u32 = u32::MAX;

/// The indices of position, texture coordinates and normal.
type Corner = [u32; 3];

impl Mesh {
    /// The faces of a Wavefront OBJ file, plain or compressed by gzip, as one mesh; materials, groups, lines and points are skipped.
    /// Polygons are cut into triangles, concave ones by their ears. With `smooth` the shading normals
    /// are the file's or, where it has none, the mean around the vertex, weighted by area.
    ///
    /// # Errors
    /// [`Error::Asset`], with the line where there is one, when the file cannot be read, is not text,
    /// or has a malformed number, an index out of range, or no face with an area; [`Error::Limit`]
    /// when it is too large.
    pub fn load(path: &Path, smooth: bool) -> Result<Mesh> {
        if cfg!(not(feature = "obj")) {
            return Err(Error::asset(path, Error::left_out("Wavefront OBJ files", "obj")));
        }
        let found = fs::metadata(path).map_err(|e| Error::asset(path, e))?;
        if !found.is_file() {
            return Err(Error::asset(path, "not a file: expected a Wavefront OBJ file"));
        }
        if found.len() > MAX_BYTES {
            let message = format!("{}: {} bytes: at most {MAX_BYTES} can be read", path.display(), found.len());
            return Err(Error::Limit(message));
        }
        let mut bytes = fs::read(path).map_err(|e| Error::asset(path, e))?;
        if bytes.starts_with(&GZIP) {
            bytes = unpack(&bytes, path)?;
        }
        let text = String::from_utf8(bytes).map_err(|e| {
            let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
            Error::asset(path, format!("line {line}: not UTF-8 text: expected a Wavefront OBJ file"))
        })?;
        let parts = parse(&text).map_err(|(line, message)| Error::asset(path, format!("line {line}: {message}")))?;
        if parts.triangles.is_empty() {
            return Err(Error::asset(path, "no faces: expected at least one line `f` with three corners or more"));
        }
        Mesh::from_parts(parts, smooth).map_err(|e| match e {
            Error::Scene(message) => Error::asset(path, message),
            Error::Limit(message) => Error::Limit(format!("{}: {message}", path.display())),
            other => other,
        })
    }
}

/// How files compressed by gzip begin (RFC 1952).
const GZIP: [u8; 2] = [0x1f, 0x8b];

#[cfg(not(feature = "obj"))]
fn unpack(_: &[u8], path: &Path) -> Result<Vec<u8>> {
    Err(Error::asset(path, Error::left_out("files packed by gzip", "obj")))
}

#[cfg(feature = "obj")]
fn unpack(bytes: &[u8], path: &Path) -> Result<Vec<u8>> {
    use std::io::Read;

    let mut unpacked = Vec::new();
    flate2::read::MultiGzDecoder::new(bytes)
        .take(MAX_BYTES + 1)
        .read_to_end(&mut unpacked)
        .map_err(|e| Error::asset(path, format!("cannot be unpacked by gzip: {e}: the file is damaged")))?;
    if unpacked.len() as u64 > MAX_BYTES {
        return Err(Error::Limit(format!(
            "{}: unpacks to more than the {MAX_BYTES} bytes that can be read",
            path.display()
        )));
    }
    Ok(unpacked)
}

/// A line number and what is wrong there.
type Fault = (usize, String);

fn parse(text: &str) -> Result<Parts, Fault> {
    let (mut positions, mut uvs, mut normals) = (Vec::new(), Vec::new(), Vec::new());
    let mut corners: Vec<Corner> = Vec::new();
    // The line of each face and where its corners end.
    let mut faces: Vec<(usize, usize)> = Vec::new();
    let mut lines = text.lines().enumerate();
    let mut joined = String::new();
    while let Some((i, line)) = lines.next() {
        let number = i + 1;
        // ---- a backslash at the end continues the line
        let mut statement = line;
        if line.ends_with('\\') {
            joined.clear();
            joined.push_str(line);
            while joined.ends_with('\\') {
                joined.pop();
                joined.push(' ');
                match lines.next() {
                    Some((_, next)) => joined.push_str(next),
                    None => break,
                }
            }
            statement = &joined;
        }
        let statement = statement.split('#').next().unwrap_or_default();
        let mut words = statement.split_whitespace();
        let fault = |message: String| (number, message);
        match words.next() {
            Some("v") => positions.push(Vec3::from_array(numbers(&mut words, "v", 3).map_err(fault)?)),
            Some("vn") => normals.push(Vec3::from_array(numbers(&mut words, "vn", 3).map_err(fault)?)),
            Some("vt") => uvs.push(Vec2::from_array(numbers(&mut words, "vt", 1).map_err(fault)?)),
            Some("f") => {
                let counts = [positions.len(), uvs.len(), normals.len()];
                let start = corners.len();
                for word in words {
                    corners.push(corner(word, counts).map_err(fault)?);
                }
                if corners.len() - start < 3 {
                    return Err(fault("a face with fewer than three corners".into()));
                }
                faces.push((number, corners.len()));
            }
            _ => {}
        }
    }
    // ---- faces may name what comes later in the file
    let names = [("vertex", positions.len()), ("texture coordinate", uvs.len()), ("normal", normals.len())];
    let mut start = 0;
    let mut index = Index::default();
    let (mut triangles, mut cut) = (Vec::new(), Vec::new());
    for &(line, end) in &faces {
        let face = &corners[start..end];
        start = end;
        for corner in face {
            for (&index, (name, count)) in corner.iter().zip(names) {
                let absent = index == ABSENT && name != "vertex";
                if !absent && index as usize >= count {
                    let message = format!("a face names {name} {}, but the file has {count}", u64::from(index) + 1);
                    return Err((line, message));
                }
            }
        }
        let outline: Vec<DVec3> = face.iter().map(|c| positions[c[0] as usize].as_dvec3()).collect();
        cut.clear();
        triangulate(&outline, &mut cut).map_err(|message| (line, message))?;
        triangles.extend(cut.iter().map(|t| t.map(|i| index.vertex(face[i]))));
        if triangles.len() > MAX_TRIANGLES {
            return Err((line, format!("more than {MAX_TRIANGLES} triangles")));
        }
    }
    // ---- one vertex for each combination of indices
    let has_uvs = !uvs.is_empty() && index.vertices.iter().any(|c| c[1] != ABSENT);
    let position = |c: &Corner| positions[c[0] as usize];
    let uv = |c: &Corner| uvs.get(c[1] as usize).copied().unwrap_or_default();
    let normal = |c: &Corner| normals.get(c[2] as usize).copied().unwrap_or_default();
    Ok(Parts {
        positions: index.vertices.iter().map(position).collect(),
        normals: index.vertices.iter().map(normal).collect(),
        uvs: if has_uvs { index.vertices.iter().map(uv).collect() } else { Vec::new() },
        triangles,
    })
}

/// Combinations of indices that occur.
#[derive(Default)]
struct Index {
    known: HashMap<Corner, u32>,
    vertices: Vec<Corner>,
}

impl Index {
    fn vertex(&mut self, corner: Corner) -> u32 {
        *self.known.entry(corner).or_insert_with(|| {
            self.vertices.push(corner);
            self.vertices.len() as u32 - 1
        })
    }
}

/// The first `N` numbers of a statement, of which `required` must be there.
fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a str>,
    key: &str,
    required: usize,
) -> Result<[f32; N], String> {
    let mut values = [0f32; N];
    for (i, value) in values.iter_mut().enumerate() {
        match words.next() {
            Some(word) => {
                *value = word.parse().map_err(|_| format!("`{word}` in `{key}`: expected a number"))?;
                if !value.is_finite() {
                    return Err(format!("`{word}` in `{key}`: expected a finite number"));
                }
            }
            None if i < required => return Err(format!("`{key}` with {i} numbers: expected {required}")),
            None => break,
        }
    }
    Ok(values)
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 1, or negative to count back from the latest.
fn corner(word: &str, counts: [usize; 3]) -> Result<Corner, String> {
    let mut corner = [ABSENT; 3];
    let mut fields = word.split('/');
    for (k, count) in counts.into_iter().enumerate() {
        let Some(field) = fields.next() else { break };
        if field.is_empty() && k > 0 {
            continue;
        }
        let wrong = || format!("`{word}` in a face: expected v, v/vt, v//vn or v/vt/vn with indices from 1 or below 0");
        let value: i64 = field.parse().map_err(|_| wrong())?;
        let index = if value > 0 { Some(value - 1) } else { value.checked_add(count as i64).filter(|_| value < 0) };
        corner[k] = index.and_then(|i| u32::try_from(i).ok()).filter(|&i| i != ABSENT).ok_or_else(wrong)?;
    }
    if fields.next().is_some() || corner[0] == ABSENT {
        return Err(format!("`{word}` in a face: expected v, v/vt, v//vn or v/vt/vn"));
    }
    Ok(corner)
}

/// Cuts a polygon into triangles: a fan if it is convex, otherwise ears (Eberly 2008, "Triangulation by
/// ear clipping") in the plane of its mean normal (Newell's).
fn triangulate(outline: &[DVec3], out: &mut Vec<[usize; 3]>) -> Result<(), String> {
    let n = outline.len();
    if n == 3 {
        out.push([0, 1, 2]);
        return Ok(());
    }
    // ---- onto the plane, seen so that the polygon runs counter-clockwise
    let origin = outline[0];
    let normal: DVec3 = (0..n).map(|i| (outline[i] - origin).cross(outline[(i + 1) % n] - origin)).sum();
    let axis = normal.abs();
    let flat: Vec<DVec2> = outline
        .iter()
        .map(|p| {
            if axis.x >= axis.y && axis.x >= axis.z {
                DVec2::new(p.y, p.z * normal.x.signum())
            } else if axis.y >= axis.z {
                DVec2::new(p.z, p.x * normal.y.signum())
            } else {
                DVec2::new(p.x, p.y * normal.z.signum())
            }
        })
        .collect();
    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]);
    if (0..n).all(|i| turn(i, (i + 1) % n, (i + 2) % n) >= 0.0) {
        out.extend((1..n - 1).map(|i| [0, i, i + 1]));
        return Ok(());
    }
    if n > MAX_CONCAVE {
        return Err(format!("a concave face with {n} corners: at most {MAX_CONCAVE} can be cut; use smaller faces"));
    }
    // ---- ears: convex corners whose triangle contains no other corner
    let mut rest: Vec<usize> = (0..n).collect();
    while rest.len() > 3 {
        let m = rest.len();
        let is_ear = |i: usize| {
            let (a, b, c) = (rest[(i + m - 1) % m], rest[i], rest[(i + 1) % m]);
            let blocks = |&p: &usize| {
                let apart = flat[p] != flat[a] && flat[p] != flat[b] && flat[p] != flat[c];
                apart && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
            };
            turn(a, b, c) > 0.0 && !rest.iter().any(blocks)
        };
        // A polygon that crosses itself may have no ear; any corner is then as good as another.
        let ear = (0..m).find(|&i| is_ear(i)).unwrap_or(0);
        out.push([rest[(ear + m - 1) % m], rest[ear], rest[(ear + 1) % m]]);
        rest.remove(ear);
    }
    out.push([rest[0], rest[1], rest[2]]);
    Ok(())
}

#[cfg(all(test, feature = "obj"))]
mod tests {
    use super::*;
    use crate::geometry::{Cluster, Geometry, Placed, Shape};
    use crate::math::{DAffine3, Ray};
    use std::io::Write;
    use std::sync::Arc;

    fn load(bytes: &[u8], smooth: bool) -> Result<Mesh> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a mesh – ünïcode.obj");
        fs::write(&path, bytes).unwrap();
        Mesh::load(&path, smooth)
    }

    /// A unit cube of quads, one by negative indices, one over two lines, wound inward, with seams:
    /// every face has its own copy of the first vertex.
    const CUBE: &str = "# cube\nmtllib missing.mtl\no cube\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0 1 0.5 0.5 0.5\n\
        v 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl x\ns 1\n\
        f 1/1 2/2 4/3 3/4\nf 5/1 7/2 8/3 6/4\nv -0 0 0\nf 9/1 5/2 6/3 \\\n2/4\nv 0 0 0\nf 10 3 7 5\n\
        f -9/-4 -5/-3 -3/-2 -7/-1\nf 3/1 4/2 8/3 7/4 # end\nl 1 2\np 1\n";

    /// Triangles and convex quads, where `tobj` is right.
    #[test]
    fn tobj_reads_the_same() {
        let mut text = String::new();
        let (rows, columns) = (9, 14);
        for j in 0..=rows {
            for i in 0..columns {
                let (theta, phi) =
                    (3.1 * (j as f64 + 0.1) / rows as f64, std::f64::consts::TAU * i as f64 / columns as f64);
                let r = 1.0 + 0.1 * (3.0 * phi).sin() * theta.sin();
                let (x, y, z) = (r * theta.sin() * phi.cos(), r * theta.cos(), r * theta.sin() * phi.sin());
                text += &format!("v {x} {y} {z}\nvn {x} {y} {z}\n");
            }
        }
        for j in 0..rows {
            for i in 0..columns {
                let at = |i: usize, j: usize| 1 + j * columns + i % columns;
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                text += &match (i + j) % 3 {
                    0 => format!("f {a}//{a} {b}//{b} {c}//{c}\nf {a}//{a} {c}//{c} {d}//{d}\n"),
                    1 => format!("f {a} {b} {c}\nf {a} {c} {d}\n"),
                    _ => format!("f {b}//{b} {c}//{c} {d}//{d} {a}//{a}\n"),
                };
            }
        }
        let ours = load(text.as_bytes(), true).unwrap();
        let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
        let (theirs, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Ok(Default::default())).unwrap();
        let (mut count, mut area) = (0, 0.0);
        let mut bounds = crate::math::Bounds::EMPTY;
        for model in theirs {
            let corner = |i: u32| Vec3::from_slice(&model.mesh.positions[3 * i as usize..][..3]).as_dvec3();
            for triangle in model.mesh.indices.chunks(3) {
                let [a, b, c] = [corner(triangle[0]), corner(triangle[1]), corner(triangle[2])];
                count += 1;
                area += 0.5 * (b - a).cross(c - a).length();
                bounds = bounds.union(crate::math::Bounds::of_points([a, b, c]));
            }
        }
        assert_eq!(ours.triangle_count(), count);
        assert!((ours.area() / area - 1.0).abs() < 1e-6, "{} against {area}", ours.area());
        assert_eq!(ours.bounds(), bounds);
    }

    #[test]
    fn a_cube_of_quads_is_closed_and_faces_out() {
        let mesh = load(CUBE.as_bytes(), false).unwrap();
        assert_eq!(mesh.triangle_count(), 12);
        assert!(mesh.is_closed());
        assert!((mesh.area() - 6.0).abs() < 1e-12 && (mesh.volume().unwrap() - 1.0).abs() < 1e-12);
        let geometry = Geometry::new(vec![Placed::new(Shape::Mesh(Arc::new(mesh)), DAffine3::IDENTITY).unwrap()]);
        let mut cluster = Cluster::default();
        for axis in DVec3::AXES {
            let ray = Ray::new(DVec3::new(0.4, 0.3, 0.2) - 5.0 * axis, axis);
            assert!(geometry.intersect(&ray, 0.0, 10.0, &mut cluster));
            assert_eq!(cluster.nearest().unwrap().normal, -axis);
        }
        assert!(geometry.contains(0, DVec3::splat(0.5)) && !geometry.contains(0, DVec3::new(0.5, 0.5, 1.1)));
        // One face less.
        let open = load(CUBE.replace("f 10 3 7 5\n", "").as_bytes(), false).unwrap();
        assert!(!open.is_closed() && open.volume().is_none() && open.triangle_count() == 10);
    }

    fn gzip(text: &str) -> Vec<u8> {
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        out.write_all(text.as_bytes()).unwrap();
        out.finish().unwrap()
    }

    #[test]
    fn compressed_files_are_the_same_mesh() {
        let (plain, packed) = (load(CUBE.as_bytes(), true).unwrap(), load(&gzip(CUBE), true).unwrap());
        assert_eq!((plain.triangle_count(), plain.volume()), (packed.triangle_count(), packed.volume()));
        assert!((0..12).all(|i| plain.corners(i) == packed.corners(i)));
    }

    #[test]
    fn smooth_normals_are_the_files_or_the_mean() {
        // ---- a roof: the ridge's mean points up, the file's normal wins
        let roof = "v -1 0 0\nv 0 1 0\nv 0 1 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\nvn 0 0 -7\n";
        let plain = format!("{roof}f 1 4 3 2\nf 2 3 6 5\n");
        let named = format!("{roof}f 1//1 4//1 3//1 2//1\nf 2 3 6 5\n");
        let look = |text: &str, smooth: bool| {
            let mesh = Shape::Mesh(Arc::new(load(text.as_bytes(), smooth).unwrap()));
            let geometry = Geometry::new(vec![Placed::new(mesh, DAffine3::IDENTITY).unwrap()]);
            let mut cluster = Cluster::default();
            assert!(geometry.intersect(&Ray::new(DVec3::new(-1e-9, 5.0, 0.5), DVec3::NEG_Y), 0.0, 9.0, &mut cluster));
            let hit = *cluster.nearest().unwrap();
            assert!(hit.normal.distance(DVec3::new(-1.0, 1.0, 0.0).normalize()) < 1e-6, "counter-clockwise is out");
            hit.shading_normal
        };
        assert!(look(&plain, true).distance(DVec3::Y) < 1e-6);
        assert!(look(&plain, false).distance(DVec3::new(-1.0, 1.0, 0.0).normalize()) < 1e-6);
        assert!(look(&named, true).distance(DVec3::NEG_Z) < 1e-6);
    }

    #[test]
    fn concave_polygons_keep_their_outline() {
        // ---- a comb in a tilted plane, both ways round
        let mut outline: Vec<DVec2> = vec![DVec2::new(0.0, -1.0), DVec2::new(9.0, -1.0)];
        for i in (0..9).rev() {
            outline.push(DVec2::new(f64::from(i) + 1.0, 0.0));
            outline.push(DVec2::new(f64::from(i) + 0.5, 2.0));
        }
        outline.push(DVec2::ZERO);
        let twice: f64 = (0..outline.len()).map(|i| outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum();
        for turned in [false, true] {
            for plane in 0..3 {
                let mut text = String::new();
                for p in &outline {
                    let mut v = [p.x, p.y, 0.0];
                    v.rotate_right(plane);
                    text += &format!("v {} {} {}\n", v[0], v[1], v[2]);
                }
                let order: Vec<String> = (1..=outline.len()).map(|i| i.to_string()).collect();
                let order = if turned { order.into_iter().rev().collect() } else { order };
                text += &format!("f {}\n", order.join(" "));
                let mesh = load(text.as_bytes(), false).unwrap();
                assert!((mesh.area() - 0.5 * twice).abs() < 1e-9, "{} {}", mesh.area(), 0.5 * twice);
                let mut normal = [0.0, 0.0, if turned { -1.0 } else { 1.0 }];
                normal.rotate_right(plane);
                for i in 0..mesh.triangle_count() as u32 {
                    assert!(mesh.normal(i).distance(DVec3::from_array(normal)) < 1e-9);
                }
            }
        }
    }

    #[test]
    fn malformed_files_are_named_with_their_line() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
        for (tail, expected) in [
            ("f 1 2 4\n", "line 4: a face names vertex 4, but the file has 3"),
            ("f 1 2 -4\n", "line 4: `-4` in a face"),
            ("f 1/1 2/1 3/1\n", "line 4: a face names texture coordinate 1, but the file has 0"),
            ("f 1//9223372036854775807 2 3\n", "line 4: `1//9223372036854775807`"),
            ("f 1 2 -9223372036854775808\n", "line 4: `-9223372036854775808`"),
            ("f 1 2 0\n", "line 4: `0` in a face"),
            ("f 1 2\n", "line 4: a face with fewer than three corners"),
            ("f 1 2 x\n", "line 4: `x` in a face"),
            ("f 1/1/1/1 2 3\n", "line 4: `1/1/1/1`"),
            ("f /1 2 3\n", "line 4: `/1`"),
            ("v 1 nan 2\nf 1 2 3\n", "line 4: `nan` in `v`: expected a finite number"),
            ("v 1 1e99 2\nf 1 2 3\n", "line 4: `1e99` in `v`: expected a finite number"),
            ("v 1 2\nf 1 2 3\n", "line 4: `v` with 2 numbers: expected 3"),
            ("", "no faces"),
            ("f 1 1 2\n", "without any triangle that has an area"),
        ] {
            let error = load(format!("{square}{tail}").as_bytes(), true).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            assert!(matches!(error, Error::Asset { .. }));
        }
        let error = load(&gzip(CUBE)[..60], true).unwrap_err();
        assert!(error.to_string().contains("the file is damaged") && matches!(error, Error::Asset { .. }), "{error}");
        let error = load(b"v 0 0 0\nv \xff", true).unwrap_err();
        assert!(error.to_string().contains("line 2: not UTF-8"), "{error}");
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(Mesh::load(folder.path(), true), Err(Error::Asset { .. })));
        assert!(matches!(Mesh::load(&folder.path().join("no.obj"), true), Err(Error::Asset { .. })));
        // ---- the cube with bytes overwritten: a mesh or an error
        const BYTES: &[u8] = b"0123456789/-. ef\nv#\\\xff";
        let mut stream = crate::math::Stream::new(3, crate::math::random::Purpose::Test, 0, 0);
        for _ in 0..2000 {
            let mut bytes = CUBE.as_bytes().to_vec();
            for _ in 0..3 {
                let at = (stream.uniform() * bytes.len() as f64) as usize;
                bytes[at] = BYTES[(stream.uniform() * BYTES.len() as f64) as usize];
            }
            if let Ok(text) = std::str::from_utf8(&bytes)
                && let Ok(parts) = parse(text)
            {
                let _ = Mesh::from_parts(parts, true);
            }
        }
    }
}
