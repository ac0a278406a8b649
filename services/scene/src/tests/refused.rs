//! Scene files that are refused, and what is said of them.

use super::minimal;
use crate::Scene;

#[test]
fn a_wrong_file_is_refused_in_words() {
    let unknown = minimal("[[wall]]\npoints = [[0.0, 0.0], [1.0, 0.0]]\n").unwrap_err().to_string();
    assert!(unknown.contains("unknown field `points`") && unknown.contains('^'), "{unknown}");
    let several = minimal(
        "[[wall]]\npoints_m = [[0.0, 0.0]]\n[[pillar]]\ncentre_m = [0.0, nan]\nradius_m = -1.0\n\
         [[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n\
         [[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\nbeams = 9000\n",
    );
    let several = several.unwrap_err().to_string();
    for words in [
        "wall 1 has 1 points, expected at least 2",
        "pillar 1 `` is NaN, expected -1000..1000 m",
        "radius_m is -1, expected 0.005..100 m",
        "two lasers have the id `l`",
        "9000 beams of laser `l`, expected 1..4096",
    ] {
        assert!(several.contains(words), "{words} is not in:\n{several}");
    }
    let through = minimal(
        "[[wall]]\npoints_m = [[0.0, -1.0], [0.0, 1.0]]\n[[route]]\nid = \"r\"\n\
         arrivals_per_hour = 10\npoint = [{ at_m = [-1.0, 0.0] }, { at_m = [1.0, 0.0] }]\n",
    );
    let through = through.unwrap_err().to_string();
    assert!(through.contains("route `r` passes wall 1 at 0.00 m"), "{through}");
    let crowd = minimal(
        "[[loop]]\nid = \"crowd\"\npeople = 1000\n\
         points_m = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]\n",
    );
    assert!(crowd.unwrap_err().to_string().contains("1000 people at once"));
    let unknown = Scene::builtin("attic").unwrap_err().to_string();
    assert!(unknown.contains("`attic`") && unknown.contains("foyer, paper-foyer"), "{unknown}");
    let none = Scene::builtin("room").unwrap().staged("fire", 0.0).unwrap_err().to_string();
    assert!(none.contains("`fire`") && none.contains("chair-moved"), "{none}");
}

#[test]
fn a_way_through_furniture_a_pillar_or_an_open_leaf_is_refused() {
    let route = "[[route]]\nid = \"r\"\narrivals_per_hour = 10\n\
                 point = [{ at_m = [-1.0, 0.0] }, { at_m = [1.0, 0.0] }]\n";
    for (thing, words) in [
        (
            "[[box]]\nid = \"desk\"\ncentre_m = [0.0, 0.5]\nsize_m = [0.6, 0.6]\n",
            "box 1 `desk` at 0.20",
        ),
        (
            "[[pillar]]\nid = \"pot\"\ncentre_m = [0.0, 0.4]\nradius_m = 0.3\n",
            "pillar 1 `pot` at 0.10",
        ),
        (
            "[[door]]\nid = \"d\"\nhinge_m = [0.0, 1.0]\nleaf_m = 0.9\nclosed_deg = 0.0\n\
             open_deg = -90.0\n",
            "the open leaf of door `d` at 0.10",
        ),
    ] {
        let error = minimal(&format!("{thing}{route}")).unwrap_err().to_string();
        assert!(error.contains(words), "{words} is not in: {error}");
    }
}
