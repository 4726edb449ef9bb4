// What a planner in C++17 needs to speak with hlsd: one header, no library.
//
//     struct Mine {
//       double period_s = 0.05;
//       void reset(const hlsd::Setup& setup) {}
//       hlsd::Command plan(const hlsd::Observation& observation) { return {0.5, 0.0}; }
//     };
//     int main() { Mine mine; return hlsd::serve(mine); }
//
// docs/external.md has the protocol. This header reads and writes the part of
// MessagePack that it uses. It is for machines with little-endian IEEE 754 numbers.

#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace hlsd {

constexpr int protocol_version = 1;
constexpr std::uint32_t longest_message = 1u << 28;

struct Limits {
  double max_speed = 0, max_acceleration = 0;          // m/s, m/s^2
  double max_yaw_rate = 0, max_yaw_acceleration = 0;   // rad/s, rad/s^2
  double half_length_m = 0, half_width_m = 0, corner_radius_m = 0;
};

struct Footprint {
  double half_length_m = 0, half_width_m = 0, corner_radius_m = 0;
};

struct Lidar {
  std::int64_t beams = 0;
  double fov_rad = 0, min_range_m = 0, max_range_m = 0, noise_sd_m = 0;
  double mount_in_base[3] = {0, 0, 0};
};

struct Setup {
  std::uint64_t seed = 0;
  Limits limits;
  Lidar lidar;
  Footprint footprint;
  double footprint_padding_m = 0;
  double goal_period_s = std::numeric_limits<double>::quiet_NaN();  // NaN: sent once
};

struct Point {
  double x = 0, y = 0;
};

struct Observation {
  double time_s = 0, speed = 0, yaw_rate = 0;
  double path_time_s = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> ranges_m;         // beam 0 to the right, anticlockwise
  double pose_in_odom[3] = {0, 0, 0};   // x, y, yaw
  std::vector<Point> path_in_odom;
  Point local_goal_in_base, goal_in_odom;
};

struct Command {
  double speed = 0, yaw_rate = 0;
  std::string mode = "plan";
};

struct Options {
  bool scan_float64 = false;    // scans to the last bit
  double plan_every_s = 0;      // between global plans; 0 leaves it to hlsd
  bool fresh_process = false;   // start anew for each episode
};

namespace detail {

// A message's content, read from the front.
class Reader {
 public:
  Reader(const unsigned char* begin, std::size_t size) : at_(begin), end_(begin + size) {}

  std::size_t map() {
    const unsigned tag = byte();
    if ((tag & 0xf0u) == 0x80u) return tag & 0x0fu;
    if (tag == 0xde) return big(2);
    if (tag == 0xdf) return big(4);
    throw std::runtime_error("no map where one belongs");
  }

  std::size_t array() {
    const unsigned tag = byte();
    if ((tag & 0xf0u) == 0x90u) return tag & 0x0fu;
    if (tag == 0xdc) return big(2);
    if (tag == 0xdd) return big(4);
    throw std::runtime_error("no array where one belongs");
  }

  std::string text() {
    const unsigned tag = byte();
    std::size_t size = 0;
    if ((tag & 0xe0u) == 0xa0u) size = tag & 0x1fu;
    else if (tag == 0xd9) size = big(1);
    else if (tag == 0xda) size = big(2);
    else if (tag == 0xdb) size = big(4);
    else throw std::runtime_error("no text where one belongs");
    const unsigned char* from = take(size);
    return std::string(reinterpret_cast<const char*>(from), size);
  }

  std::pair<const unsigned char*, std::size_t> binary() {
    const unsigned tag = byte();
    if (tag < 0xc4 || tag > 0xc6) throw std::runtime_error("no binary where one belongs");
    const std::size_t size = big(1u << (tag - 0xc4));
    return {take(size), size};
  }

  // nil reads as NaN.
  double number() {
    const unsigned tag = *peek();
    if (tag == 0xc0) {
      byte();
      return std::numeric_limits<double>::quiet_NaN();
    }
    if (tag == 0xca || tag == 0xcb) {
      byte();
      if (tag == 0xca) {
        const std::uint32_t bits = static_cast<std::uint32_t>(big(4));
        float value;
        std::memcpy(&value, &bits, 4);
        return value;
      }
      const std::uint64_t bits = big(8);
      double value;
      std::memcpy(&value, &bits, 8);
      return value;
    }
    return static_cast<double>(static_cast<std::int64_t>(integer()));
  }

  // Of a negative one, its two's complement.
  std::uint64_t integer() {
    const unsigned tag = byte();
    if (tag < 0x80) return tag;
    if (tag >= 0xe0) return static_cast<std::uint64_t>(static_cast<std::int64_t>(tag) - 256);
    if (tag >= 0xcc && tag <= 0xcf) return big(1u << (tag - 0xcc));
    switch (tag) {
      case 0xd0: return static_cast<std::uint64_t>(static_cast<std::int8_t>(big(1)));
      case 0xd1: return static_cast<std::uint64_t>(static_cast<std::int16_t>(big(2)));
      case 0xd2: return static_cast<std::uint64_t>(static_cast<std::int32_t>(big(4)));
      case 0xd3: return big(8);
    }
    throw std::runtime_error("no number where one belongs");
  }

  // Whatever comes next: fields that this header does not know.
  void skip() {
    const unsigned tag = *peek();
    if ((tag & 0xf0u) == 0x80u || tag == 0xde || tag == 0xdf) {
      for (std::size_t n = 2 * map(); n > 0; --n) skip();
    } else if ((tag & 0xf0u) == 0x90u || tag == 0xdc || tag == 0xdd) {
      for (std::size_t n = array(); n > 0; --n) skip();
    } else if ((tag & 0xe0u) == 0xa0u || (tag >= 0xd9 && tag <= 0xdb)) {
      text();
    } else if (tag >= 0xc4 && tag <= 0xc6) {
      binary();
    } else if (tag == 0xc2 || tag == 0xc3) {
      byte();
    } else {
      number();
    }
  }

 private:
  const unsigned char* peek() {
    if (at_ == end_) throw std::runtime_error("a message ends early");
    return at_;
  }

  const unsigned char* take(std::size_t size) {
    if (static_cast<std::size_t>(end_ - at_) < size)
      throw std::runtime_error("a message ends early");
    const unsigned char* from = at_;
    at_ += size;
    return from;
  }

  unsigned byte() { return *take(1); }

  std::uint64_t big(std::size_t size) {
    const unsigned char* from = take(size);
    std::uint64_t value = 0;
    for (std::size_t k = 0; k < size; ++k) value = value << 8 | from[k];
    return value;
  }

  const unsigned char* at_;
  const unsigned char* end_;
};

// A message, with room for its length in front.
class Writer {
 public:
  explicit Writer(unsigned fields) : bytes_(4) {
    bytes_.push_back(static_cast<unsigned char>(0x80u | fields));  // up to 15 fields
  }

  void text(const std::string& held) {
    bytes_.push_back(0xdb);
    big(held.size(), 4);
    bytes_.insert(bytes_.end(), held.begin(), held.end());
  }

  void integer(std::uint64_t held) {
    bytes_.push_back(0xcf);
    big(held, 8);
  }

  void number(double held) {
    std::uint64_t bits;
    std::memcpy(&bits, &held, 8);
    bytes_.push_back(0xcb);
    big(bits, 8);
  }

  void truth(bool held) { bytes_.push_back(held ? 0xc3 : 0xc2); }

  void send(int pipe) {
    const std::size_t size = bytes_.size() - 4;
    for (std::size_t k = 0; k < 4; ++k)
      bytes_[k] = static_cast<unsigned char>(size >> 8 * k);
    for (std::size_t sent = 0; sent < bytes_.size();) {
      const ssize_t now = ::write(pipe, bytes_.data() + sent, bytes_.size() - sent);
      if (now < 0 && errno == EINTR) continue;
      if (now < 0) throw std::runtime_error("hlsd does not listen any more");
      sent += static_cast<std::size_t>(now);
    }
  }

 private:
  void big(std::uint64_t value, int size) {
    for (int k = size - 1; k >= 0; --k)
      bytes_.push_back(static_cast<unsigned char>(value >> 8 * k));
  }

  std::vector<unsigned char> bytes_;
};

// So many bytes; false where there is no more.
inline bool read_all(int pipe, unsigned char* to, std::size_t size) {
  for (std::size_t had = 0; had < size;) {
    const ssize_t now = ::read(pipe, to + had, size - had);
    if (now < 0 && errno == EINTR) continue;
    if (now <= 0) return false;
    had += static_cast<std::size_t>(now);
  }
  return true;
}

template <class Number>
std::vector<double> numbers(Reader& reader) {
  const auto held = reader.binary();
  std::vector<double> values(held.second / sizeof(Number));
  for (std::size_t k = 0; k < values.size(); ++k) {
    Number value;
    std::memcpy(&value, held.first + k * sizeof(Number), sizeof(Number));
    values[k] = value;
  }
  return values;
}

inline std::vector<double> numbers(Reader& reader, std::size_t count) {
  std::vector<double> values = numbers<double>(reader);
  if (values.size() != count) throw std::runtime_error("an array of another shape");
  return values;
}

template <class Shape>
bool read_shape(const std::string& name, Reader& reader, Shape& shape) {
  if (name == "half_length_m") shape.half_length_m = reader.number();
  else if (name == "half_width_m") shape.half_width_m = reader.number();
  else if (name == "corner_radius_m") shape.corner_radius_m = reader.number();
  else return false;
  return true;
}

inline void read_limits(Reader& reader, Limits& to) {
  for (std::size_t n = reader.map(); n > 0; --n) {
    const std::string name = reader.text();
    if (read_shape(name, reader, to)) continue;
    if (name == "max_speed") to.max_speed = reader.number();
    else if (name == "max_acceleration") to.max_acceleration = reader.number();
    else if (name == "max_yaw_rate") to.max_yaw_rate = reader.number();
    else if (name == "max_yaw_acceleration") to.max_yaw_acceleration = reader.number();
    else reader.skip();
  }
}

inline void read_lidar(Reader& reader, Lidar& to) {
  for (std::size_t n = reader.map(); n > 0; --n) {
    const std::string name = reader.text();
    if (name == "beams") to.beams = static_cast<std::int64_t>(reader.integer());
    else if (name == "fov_rad") to.fov_rad = reader.number();
    else if (name == "min_range_m") to.min_range_m = reader.number();
    else if (name == "max_range_m") to.max_range_m = reader.number();
    else if (name == "noise_sd_m") to.noise_sd_m = reader.number();
    else if (name == "mount_in_base") {
      if (reader.array() != 3) throw std::runtime_error("a mount is x, y, z");
      for (double& held : to.mount_in_base) held = reader.number();
    } else reader.skip();
  }
}

// A question of any type: what it does not hold stays as it is.
struct Question {
  std::string type;
  std::uint64_t number = 0;
  Setup setup;
  Observation observation;

  void read(const std::vector<unsigned char>& content, bool scan_float64) {
    Reader reader(content.data(), content.size());
    for (std::size_t n = reader.map(); n > 0; --n) {
      const std::string name = reader.text();
      Observation& o = observation;
      if (name == "type") type = reader.text();
      else if (name == "number") number = reader.integer();
      else if (name == "time_s") o.time_s = reader.number();
      else if (name == "speed") o.speed = reader.number();
      else if (name == "yaw_rate") o.yaw_rate = reader.number();
      else if (name == "path_time_s") o.path_time_s = reader.number();
      else if (name == "ranges_m")
        o.ranges_m = scan_float64 ? numbers<double>(reader) : numbers<float>(reader);
      else if (name == "pose_in_odom") {
        const auto held = numbers(reader, 3);
        for (std::size_t k = 0; k < 3; ++k) o.pose_in_odom[k] = held[k];
      } else if (name == "path_in_odom") {
        const auto held = numbers<double>(reader);
        o.path_in_odom.resize(held.size() / 2);
        for (std::size_t k = 0; k < o.path_in_odom.size(); ++k)
          o.path_in_odom[k] = {held[2 * k], held[2 * k + 1]};
      } else if (name == "local_goal_in_base") {
        const auto held = numbers(reader, 2);
        o.local_goal_in_base = {held[0], held[1]};
      } else if (name == "goal_in_odom") {
        const auto held = numbers(reader, 2);
        o.goal_in_odom = {held[0], held[1]};
      } else if (name == "seed") setup.seed = reader.integer();
      else if (name == "limits") read_limits(reader, setup.limits);
      else if (name == "lidar") read_lidar(reader, setup.lidar);
      else if (name == "footprint") {
        for (std::size_t m = reader.map(); m > 0; --m)
          if (!read_shape(reader.text(), reader, setup.footprint)) reader.skip();
      } else if (name == "footprint_padding_m") setup.footprint_padding_m = reader.number();
      else if (name == "goal_period_s") setup.goal_period_s = reader.number();
      else reader.skip();
    }
  }
};

inline Writer answer(const std::string& type, std::uint64_t number, unsigned more) {
  Writer writer(2 + more);
  writer.text("type");
  writer.text(type);
  writer.text("number");
  writer.integer(number);
  return writer;
}

template <class Planner>
void hello(Planner& planner, const Options& options, std::uint64_t number, int out) {
  Writer writer = answer("hello", number, options.plan_every_s > 0 ? 5 : 4);
  writer.text("protocol");
  writer.integer(protocol_version);
  writer.text("period_s");
  writer.number(planner.period_s);
  writer.text("scan");
  writer.text(options.scan_float64 ? "float64" : "float32");
  writer.text("fresh_process");
  writer.truth(options.fresh_process);
  if (options.plan_every_s > 0) {
    writer.text("plan_every_s");
    writer.number(options.plan_every_s);
  }
  writer.send(out);
}

template <class Planner>
void plan(Planner& planner, const Question& question, int out) {
  const Command command = planner.plan(question.observation);
  Writer writer = answer("plan", question.number, 3);
  writer.text("speed");
  writer.number(command.speed);
  writer.text("yaw_rate");
  writer.number(command.yaw_rate);
  writer.text("mode");
  writer.text(command.mode);
  writer.send(out);
}

}  // namespace detail

// Answers hlsd until it says bye or is gone; what main returns.
//
// What the planner prints goes to stderr, since stdout belongs to the protocol. An
// exception becomes the reason in the row.
template <class Planner>
int serve(Planner& planner, const Options& options = {}) {
  const int out = ::dup(1);
  if (out < 0 || ::dup2(2, 1) < 0) return 1;
  detail::Question question;
  std::vector<unsigned char> content;
  unsigned char head[4];
  while (detail::read_all(0, head, 4)) {
    const std::uint32_t size = head[0] | head[1] << 8 | head[2] << 16 |
                               static_cast<std::uint32_t>(head[3]) << 24;
    if (size > longest_message) return 1;
    content.resize(size);
    if (!detail::read_all(0, content.data(), size)) return 1;
    try {
      question.read(content, options.scan_float64);
      if (question.type == "bye") return 0;
      if (question.type == "hello") {
        detail::hello(planner, options, question.number, out);
      } else if (question.type == "reset") {
        planner.reset(question.setup);
        detail::answer("reset", question.number, 0).send(out);
      } else if (question.type == "plan") {
        detail::plan(planner, question, out);
      } else {
        throw std::runtime_error("a question that this version has not");
      }
    } catch (const std::exception& error) {
      detail::Writer writer = detail::answer("error", question.number, 1);
      writer.text("text");
      writer.text(error.what());
      writer.send(out);
    }
  }
  return 0;
}

}  // namespace hlsd
