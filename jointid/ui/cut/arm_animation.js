// The cut in slow motion on two canvases: the whole arm, and the tool paths around the reference path.
//
// Streamlit calls the default function again whenever the data change and runs its clean-up only when
// the component goes away. So what runs is remembered by its parent element and stopped first.

const running = new WeakMap();

const TOOLS = ["nominal", "identified"];
const SPEED = 0.2; // of the clock, at first
const HOLD_S = 0.8; // rest at the end before the next round, in seconds of the person watching

export default function (component) {
  const { parentElement, data } = component;
  const before = running.get(parentElement);
  before?.stop();
  const animation = new CutAnimation(parentElement, data, before);
  running.set(parentElement, animation);
  return () => animation.stop();
}

class CutAnimation {
  constructor(parent, data, before) {
    this.find = (selector) => parent.querySelector(selector);
    this.root = this.find(".cut-animation");
    this.arm = this.find("canvas.arm");
    this.cut = this.find("canvas.cut");
    this.data = data;
    this.read(data.tracks);
    const still = window.matchMedia("(prefers-reduced-motion: reduce)");
    this.playing = before ? before.playing : !still.matches;
    this.speed = before ? before.speed : SPEED;
    const last = data.magnifications.length - 1;
    const common = data.magnifications.findLastIndex((m) => m * Math.max(...data.reach_m) <= data.room_m);
    this.wipe = before ? before.wipe : 0; // share of the width that shows the cut before alone; 0: both
    this.step = before ? Math.min(before.step, last) : Math.max(common, 0);
    // A person who wants no motion sees the finished cut.
    this.time = before ? Math.min(before.time, this.end) : this.playing ? 0 : this.end;
    this.seen = true;
    this.root.style.setProperty("--nominal", data.nominal);
    this.root.style.setProperty("--identified", data.identified);
    this.find(".nominal-name").textContent = data.nominal_name;
    this.cut.setAttribute("aria-label", data.description);
    this.listen(still);
    this.controls();
    this.fit();
    this.draw();
    this.schedule();
  }

  // Columns: time, reference x y, nominal x y, identified x y, contour errors of both; s, m.
  read(table) {
    const column = (index) => {
      const values = table.getChildAt(index).toArray();
      return values instanceof Float32Array ? values : Float32Array.from(values);
    };
    const [t, wx, wy, nx, ny, ix, iy, ne, ie] = Array.from({ length: 9 }, (_, k) => column(k));
    this.frames = t.length;
    this.end = t[t.length - 1];
    this.interval = this.end / (t.length - 1);
    this.reference = { x: wx, y: wy };
    this.nominal = { x: nx, y: ny, error: ne, largest: running_maximum(ne) };
    this.identified = { x: ix, y: iy, error: ie, largest: running_maximum(ie) };
  }

  get magnification() {
    return this.data.magnifications[this.step];
  }

  // Factor for the error of one tool: beyond it, its path would be only stray lines.
  factor(name) {
    const error = this.data.reach_m[TOOLS.indexOf(name)];
    const fitting = this.data.magnifications.filter(
      (m) => m <= this.magnification && m * error <= this.data.room_m,
    );
    return Math.max(1, ...fitting);
  }

  // ---- what a person does -------------------------------------------------------------------------

  listen(still) {
    this.leaving = new AbortController();
    const on = (target, name, action) =>
      target.addEventListener(name, action, { signal: this.leaving.signal });
    on(this.find(".play"), "click", () => this.toggle());
    on(this.find(".scrub input"), "input", (event) => this.jump(Number(event.target.value)));
    on(this.find(".speed select"), "change", (event) => {
      this.speed = Number(event.target.value);
      this.draw();
    });
    on(this.find(".magnify input"), "input", (event) => {
      this.step = Number(event.target.value);
      this.controls();
      this.draw();
    });
    on(this.find(".wipe input"), "input", (event) => {
      this.wipe = Number(event.target.value);
      this.controls();
      this.draw();
    });
    on(this.root, "keydown", (event) => this.key(event));
    // A button or list that has the focus would act on the space bar once more.
    on(this.root, "keyup", (event) => event.key === " " && event.preventDefault());
    on(still, "change", () => still.matches && this.pause());
    this.resized = new ResizeObserver(() => {
      this.fit();
      this.draw();
    });
    this.resized.observe(this.cut);
    this.resized.observe(this.arm);
    this.watched = new IntersectionObserver((entries) => {
      this.seen = entries[entries.length - 1].isIntersecting;
      this.schedule();
    });
    this.watched.observe(this.root);
    // Colours of the page may change without new data.
    this.themed = new MutationObserver(() => this.draw());
    this.themed.observe(document.documentElement, { attributes: true });
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    // These have values of their own, which a person without a mouse must be able to change.
    const own = event.composedPath()[0]?.matches?.(".speed select, .magnify input, .wipe input");
    const moves = { ArrowRight: 1, ArrowLeft: -1, ArrowUp: 10, ArrowDown: -10 };
    if (event.key === " ") event.repeat || this.toggle();
    else if (event.key in moves && !own) this.move(moves[event.key]);
    else if (event.key === "Home" && !own) this.jump(0);
    else if (event.key === "End" && !own) this.jump(this.end);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.time >= this.end) this.time = 0;
    this.playing = true;
    this.controls();
    this.draw();
    this.schedule();
  }

  pause() {
    this.playing = false;
    this.controls();
    this.draw();
  }

  jump(time) {
    this.pause();
    this.seek(time);
  }

  move(hundredths) {
    this.jump(Math.min(this.time, this.end) + (hundredths * this.end) / 100);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.end);
    this.draw();
  }

  controls() {
    this.find(".play").textContent = this.playing ? "❚❚ Pause" : "▶ Play";
    this.find(".play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
    this.find(".scrub input").max = this.end;
    this.find(".speed select").value = String(this.speed);
    const slider = this.find(".magnify input");
    slider.max = this.data.magnifications.length - 1;
    slider.disabled = this.data.magnifications.length < 2;
    slider.value = this.step;
    slider.setAttribute("aria-valuetext", `${this.magnification} times`);
    const wipe = this.find(".wipe input");
    wipe.value = this.wipe;
    wipe.setAttribute("aria-valuetext", this.wipe ? `${Math.round(100 * this.wipe)} %` : "off");
    const factors = TOOLS.map((name) => this.factor(name));
    const alike = factors.every((factor) => factor === this.magnification);
    this.find(".magnify output").textContent = `${alike ? "" : "up to "}× ${this.magnification}`;
    TOOLS.forEach((name, k) => {
      const drawn = this.magnification > 1 ? `(error drawn × ${factors[k]})` : "";
      this.find(`.${name}-factor`).textContent = drawn;
    });
  }

  // ---- time ---------------------------------------------------------------------------------------

  schedule() {
    if (this.frame || this.stopped || !this.playing || !this.seen) return;
    this.last = undefined;
    this.frame = requestAnimationFrame((now) => this.tick(now));
  }

  tick(now) {
    this.frame = undefined;
    if (this.stopped || !this.playing || !this.seen) return;
    const passed = this.last === undefined ? 0 : Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    this.time += passed * this.speed;
    if (this.time > this.end + HOLD_S * this.speed) this.time = 0;
    this.draw();
    this.frame = requestAnimationFrame((later) => this.tick(later));
  }

  stop() {
    this.stopped = true;
    if (this.frame) cancelAnimationFrame(this.frame);
    this.frame = undefined;
    this.leaving?.abort();
    this.resized?.disconnect();
    this.watched?.disconnect();
    this.themed?.disconnect();
  }

  // ---- drawing ------------------------------------------------------------------------------------

  fit() {
    const ratio = window.devicePixelRatio || 1;
    for (const canvas of [this.arm, this.cut]) {
      const box = canvas.getBoundingClientRect();
      if (!box.width) continue;
      canvas.width = Math.round(box.width * ratio);
      canvas.height = Math.round(box.height * ratio);
      canvas.getContext("2d").setTransform(ratio, 0, 0, ratio, 0, 0);
    }
  }

  draw() {
    if (this.stopped) return;
    const shown = Math.min(this.time, this.end);
    const place = shown / this.interval;
    const k = Math.min(Math.floor(place), this.frames - 2);
    const share = Math.min(place - k, 1);
    const at = (values) => values[k] + share * (values[k + 1] - values[k]);
    const reference = { x: at(this.reference.x), y: at(this.reference.y) };
    const tool = (name) => ({
      x: reference.x + this.factor(name) * (at(this[name].x) - reference.x),
      y: reference.y + this.factor(name) * (at(this[name].y) - reference.y),
    });
    const now = { k, reference, nominal: tool("nominal"), identified: tool("identified") };
    const style = getComputedStyle(this.root);
    this.ink = {
      text: style.color,
      reference: "#999999",
      nominal: this.data.nominal,
      identified: this.data.identified,
      paper: style.getPropertyValue("--st-background-color").trim() || "#ffffff",
    };
    this.drawCut(now);
    this.drawArm(now);
    this.report(shown, place, at(this.nominal.error), at(this.identified.error), now);
  }

  report(shown, place, nominal, identified, now) {
    this.find(".time").textContent = `${shown.toFixed(3)} s`;
    this.find(".nominal-error").textContent = millimetres(nominal);
    this.find(".identified-error").textContent = millimetres(identified);
    for (const [name, error] of [["nominal", nominal], ["identified", identified]]) {
      const before = this[name].largest[Math.min(Math.floor(place), this.frames - 1)];
      this.find(`.${name}-largest`).textContent = millimetres(Math.max(before, error));
    }
    const scrub = this.find(".scrub input");
    scrub.value = shown;
    scrub.setAttribute("aria-valuetext", `${shown.toFixed(3)} seconds`);
    const millimetre = (p) => `${(1e3 * p.x).toFixed(4)},${(1e3 * p.y).toFixed(4)}`;
    Object.assign(this.cut.dataset, {
      frame: String(Math.round(place)),
      frames: String(this.frames),
      playing: String(this.playing),
      time: shown.toFixed(4),
      speed: String(this.speed),
      magnification: String(this.magnification),
      wipe: String(this.wipe),
      factors: TOOLS.map((name) => this.factor(name)).join(" "),
      nominal: millimetre(now.nominal),
      identified: millimetre(now.identified),
    });
  }

  drawCut(now) {
    const view = this.view(this.cut, this.data.window_m);
    const { pen } = view;
    this.trace(view, this.reference, this.frames - 1, { colour: this.ink.reference, width: 6, alpha: 0.55 });
    for (const name of TOOLS) {
      pen.save();
      this.clip(view, name);
      const factor = this.factor(name);
      this.band(view, this[name], now.k, this.ink[name], factor);
      const whole = { colour: this.ink[name], width: 1, alpha: 0.55 };
      this.trace(view, this[name], this.frames - 1, whole, factor);
      const done = { colour: this.ink[name], width: 2.5, alpha: 1 };
      this.trace(view, this[name], now.k, done, factor, now[name]);
      pen.restore();
    }
    for (const name of TOOLS) {
      pen.save();
      this.clip(view, name);
      pen.beginPath();
      pen.arc(view.x(now[name].x), view.y(now[name].y), name === "nominal" ? 6.5 : 5, 0, 2 * Math.PI);
      pen.fillStyle = name === "nominal" ? this.ink.paper : this.ink[name];
      pen.fill();
      pen.lineWidth = 2.5;
      pen.strokeStyle = this.ink[name];
      pen.stroke();
      pen.restore();
    }
    if (this.wipe) this.divide(view);
    this.scale(view);
  }

  // The wipe: the cut before left of a line, the cut after right of it.
  clip(view, name) {
    if (!this.wipe) return;
    const x = this.wipe * view.width;
    view.pen.beginPath();
    if (name === "nominal") view.pen.rect(0, 0, x, view.height);
    else view.pen.rect(x, 0, view.width - x, view.height);
    view.pen.clip();
  }

  divide(view) {
    const { pen } = view;
    const x = this.wipe * view.width;
    pen.strokeStyle = this.ink.text;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x, 0);
    pen.lineTo(x, view.height);
    pen.stroke();
    pen.font = `13px ${getComputedStyle(this.root).fontFamily}`;
    pen.textBaseline = "top";
    for (const [name, align, gap] of [["nominal", "right", -8], ["identified", "left", 8]]) {
      pen.textAlign = align;
      pen.fillStyle = this.ink[name];
      pen.fillText(name === "nominal" ? this.data.nominal_name : name, x + gap, 8);
    }
    pen.textAlign = "left";
  }

  // The error so far: the area between the reference path and the tool's.
  band(view, track, last, colour, factor) {
    const { pen } = view;
    pen.beginPath();
    for (let k = 0; k <= last; k += 1) this.point(view, track, k, factor);
    for (let k = last; k >= 0; k -= 1) this.point(view, track, k, 0);
    pen.globalAlpha = 0.18;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }

  point(view, track, k, factor) {
    const { x: wx, y: wy } = this.reference;
    view.pen.lineTo(
      view.x(wx[k] + factor * (track.x[k] - wx[k])),
      view.y(wy[k] + factor * (track.y[k] - wy[k])),
    );
  }

  trace(view, track, last, stroke, factor = 1, tip = undefined) {
    const { pen } = view;
    pen.beginPath();
    for (let k = 0; k <= last; k += 1) this.point(view, track, k, factor);
    if (tip) pen.lineTo(view.x(tip.x), view.y(tip.y));
    pen.globalAlpha = stroke.alpha;
    pen.lineWidth = stroke.width;
    pen.lineJoin = pen.lineCap = "round";
    pen.strokeStyle = stroke.colour;
    pen.stroke();
    pen.globalAlpha = 1;
  }

  scale(view) {
    const { pen } = view;
    const length = 0.01 * view.scale;
    const [x, y] = [14, view.height - 14];
    pen.strokeStyle = pen.fillStyle = this.ink.text;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x, y - 4);
    pen.lineTo(x, y);
    pen.lineTo(x + length, y);
    pen.lineTo(x + length, y - 4);
    pen.stroke();
    pen.font = `13px ${getComputedStyle(this.root).fontFamily}`;
    pen.textBaseline = "bottom";
    const [first, second] = TOOLS.map((name) => this.factor(name));
    const each = first === second ? `errors × ${first}` : `errors: ${this.data.nominal_name} × ${first}, identified × ${second}`;
    const errors = this.magnification > 1 ? `, ${each}` : "";
    pen.fillText(`10 mm${errors}`, x + length + 8, y + 4);
  }

  drawArm(now) {
    const view = this.view(this.arm, this.data.cell_m);
    const { pen } = view;
    const [l1, l2] = this.data.length_m;
    // The sheet, with the reference path on it.
    pen.fillStyle = this.ink.reference;
    pen.globalAlpha = 0.18;
    const [sx, sy, sw, sh] = this.data.sheet_m;
    pen.fillRect(view.x(sx), view.y(sy + sh), sw * view.scale, sh * view.scale);
    pen.globalAlpha = 1;
    this.trace(view, this.reference, this.frames - 1, { colour: this.ink.text, width: 1.2, alpha: 0.9 });
    for (const name of TOOLS) {
      const pose = reach(now[name], l1, l2);
      if (!pose) continue; // magnified out of reach
      if (name === "identified") this.body(view, pose, now[name], l2);
      this.bones(view, pose, now[name], this.ink[name], name === "nominal" ? [7, 5] : []);
    }
    pen.fillStyle = this.ink.text;
    pen.font = `13px ${getComputedStyle(this.root).fontFamily}`;
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    pen.fillText(this.data.serial ? "motor 1" : "motors 1, 2", view.x(0), view.y(0) - 20);
    pen.textBaseline = "top";
    if (this.data.serial) {
      const pose = reach(now.identified, l1, l2);
      if (pose) pen.fillText("motor 2", view.x(pose.x), view.y(pose.y) + 16);
    }
    pen.textAlign = "left";
  }

  body(view, elbow, tool, l2) {
    const { pen } = view;
    const link = (from, to, width) => {
      pen.beginPath();
      pen.moveTo(view.x(from.x), view.y(from.y));
      pen.lineTo(view.x(to.x), view.y(to.y));
      pen.lineWidth = width;
      pen.lineCap = "round";
      pen.stroke();
    };
    const base = { x: 0, y: 0 };
    pen.strokeStyle = this.ink.reference;
    pen.globalAlpha = 0.4;
    link(base, elbow, 24);
    link(elbow, tool, 16);
    pen.globalAlpha = 0.7;
    if (!this.data.serial) {
      // The crank of motor 2 and its rod stay parallel to link 2 and link 1.
      const share = -this.data.crank_m / l2;
      const back = { x: share * (tool.x - elbow.x), y: share * (tool.y - elbow.y) };
      const heel = { x: elbow.x + back.x, y: elbow.y + back.y };
      link(base, back, 4);
      link(back, heel, 4);
      link(heel, elbow, 4);
    }
    pen.globalAlpha = 1;
    pen.strokeStyle = this.ink.text;
    pen.fillStyle = this.ink.paper;
    pen.lineWidth = 1.5;
    for (const [joint, radius] of [[base, 14], [elbow, 10]]) {
      pen.beginPath();
      pen.arc(view.x(joint.x), view.y(joint.y), radius, 0, 2 * Math.PI);
      pen.fill();
      pen.stroke();
    }
  }

  bones(view, elbow, tool, colour, dash) {
    const { pen } = view;
    pen.beginPath();
    pen.moveTo(view.x(0), view.y(0));
    pen.lineTo(view.x(elbow.x), view.y(elbow.y));
    pen.lineTo(view.x(tool.x), view.y(tool.y));
    pen.setLineDash(dash);
    pen.lineWidth = dash.length ? 2 : 2.5;
    pen.lineJoin = "round";
    pen.strokeStyle = colour;
    pen.stroke();
    pen.setLineDash([]);
  }

  // A blank canvas that maps metres to pixels, the window (x, y, width, height) centred in it.
  view(canvas, [x0, y0, across, up]) {
    const pen = canvas.getContext("2d");
    const { clientWidth: width, clientHeight: height } = canvas;
    pen.clearRect(0, 0, canvas.width, canvas.height); // below its border too
    const scale = Math.min(width / across, height / up);
    const [cx, cy] = [x0 + across / 2, y0 + up / 2];
    return {
      pen,
      scale,
      width,
      height,
      x: (value) => width / 2 + (value - cx) * scale,
      y: (value) => height / 2 - (value - cy) * scale,
    };
  }
}

function running_maximum(values) {
  let largest = 0;
  return Float32Array.from(values, (value) => (largest = Math.max(largest, value)));
}

// The elbow of an arm that reaches a point, link 2 turned counter-clockwise; nothing out of reach.
function reach(point, l1, l2) {
  const cosine = (point.x ** 2 + point.y ** 2 - l1 ** 2 - l2 ** 2) / (2 * l1 * l2);
  if (Math.abs(cosine) > 1) return undefined;
  const bend = Math.acos(cosine);
  const angle =
    Math.atan2(point.y, point.x) - Math.atan2(l2 * Math.sin(bend), l1 + l2 * Math.cos(bend));
  return { x: l1 * Math.cos(angle), y: l1 * Math.sin(angle) };
}

function millimetres(metres) {
  return metres < 1e-6 ? "<0.001 mm" : `${(1e3 * metres).toFixed(3)} mm`;
}
