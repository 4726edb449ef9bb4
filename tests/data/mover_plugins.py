"""Plug-ins like DynaBARN's, compiled here: tiny classes stand in for Gazebo's."""

import shutil
import subprocess
from pathlib import Path

import pytest

_CLASSES = """
#include <memory>
#include <string>
namespace ignition { namespace math { inline namespace VERSION {
template <typename T> class Vector3 {
 public: Vector3(BY x, BY y, BY z) { data[0] = x; data[1] = y; data[2] = z; }
 HEAD private: T data[3];
};
template <typename T> class Quaternion {
 public: Quaternion(BY r, BY p, BY y) { data[0] = r; data[1] = p; data[2] = y; }
 private: T data[4];
};
typedef Vector3<double> Vector3d;
typedef Quaternion<double> Quaterniond;
}}}
namespace gazebo {
namespace common {
struct PoseKeyFrame {
  void Translation(const ignition::math::Vector3d &);
  void Rotation(const ignition::math::Quaterniond &);
};
struct PoseAnimation {
  PoseAnimation(const std::string &, const double, const bool);
  virtual ~PoseAnimation();
  PoseKeyFrame *CreateKeyFrame(double);
};
typedef std::shared_ptr<PoseAnimation> PoseAnimationPtr;
}
struct Model { void SetAnimation(common::PoseAnimationPtr); };
struct ModelPlugin { virtual ~ModelPlugin() {} virtual void Load(Model *) = 0; };
struct Mover : ModelPlugin {
  Model *model;
  void Load(Model *parent) {
    this->model = parent;
    common::PoseAnimationPtr anim(
        new common::PoseAnimation("mover", LENGTH, REPEATS));
    common::PoseKeyFrame *key;
    BODY
    parent->SetAnimation(anim);
  }
};
}
extern "C" gazebo::ModelPlugin *RegisterPlugin() { return new gazebo::Mover(); }
"""


def key_code(time, x, y, z="0", turn="0, 0, 0"):
    """C++ that makes a key; numbers as they stand in the source."""
    return (
        f"key = anim->CreateKeyFrame({time});\n"
        f"key->Translation(ignition::math::Vector3d({x}, {y}, {z}));\n"
        f"key->Rotation(ignition::math::Quaterniond({turn}));\n"
    )


def keys_code(keys):
    """C++ that makes keys of numbers, to 2 decimals as DynaBARN's."""
    return "".join(key_code(*(f"{number:.2f}" for number in key)) for key in keys)


def compile_plugin(
    file: Path,
    body: str,
    length: str,
    *,
    repeats: str = "true",
    by: str = "const T &",
    head: str = "",
    version: str = "v4",
    options: tuple[str, ...] = ("-O0",),
) -> Path:
    """Compile a plug-in; the test skips where there is no compiler.

    Args:
        file: To write.
        body: C++ that makes the keys.
        length: Of the animation [s].
        repeats: Of the animation.
        by: How constructors of vectors take numbers.
        head: More of the class of vectors.
        version: Inner namespace of the library of vectors.
        options: Of the compiler.
    """
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("needs g++, which is not there")
    code = _CLASSES
    for word, said in (
        *(("VERSION", version), ("BY", by), ("HEAD", head), ("LENGTH", length)),
        *(("REPEATS", repeats), ("BODY", body)),
    ):
        code = code.replace(word, said)
    done = subprocess.run(
        [compiler, *options, "-shared", "-fPIC", "-x", "c++", "-", "-o", str(file)],
        input=code,
        text=True,
        capture_output=True,
        check=False,
    )
    if "-m32" in options and done.returncode != 0:
        pytest.skip("g++ cannot compile for 32 bits here")
    assert done.returncode == 0, done.stderr
    return file
