// The cloud, to be turned: after calibration in centimetres, before as steps from there.
(() => {
  const view = document.getElementById("turning"), canvas = view.querySelector("canvas");
  const gl = canvas.getContext("webgl");
  if (!gl) return; // the picture above is there in any case
  const n = +view.dataset.points;
  const bytes = Uint8Array.from(atob(view.querySelector("script").textContent), (c) => c.charCodeAt(0));
  const compile = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    return shader;
  };
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl.VERTEX_SHADER, `
    attribute vec3 after, shift; attribute float strip;
    uniform float t, step, size, byHeight; uniform vec3 centre; uniform mat4 turn; uniform vec3 colours[8];
    varying vec3 colour;
    void main() {
      vec3 p = 0.01 * (after + (1.0 - t) * step * shift);
      gl_Position = turn * vec4(p - centre, 1.0);
      gl_PointSize = clamp(size / gl_Position.w, 1.0, 9.0);
      float h = clamp(p.z / 9.0, 0.0, 1.0);
      vec3 height = mix(mix(vec3(.0, .13, .3), vec3(.49, .48, .47), min(2.0 * h, 1.0)),
                        vec3(.98, .86, .2), max(2.0 * h - 1.0, 0.0));
      colour = height;
      for (int k = 0; k < 8; k++) if (byHeight < 0.5 && abs(strip - float(k)) < 0.5) colour = colours[k];
    }`));
  gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `
    precision mediump float; varying vec3 colour;
    void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; gl_FragColor = vec4(colour, 1.0); }`));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  const parts = { after: [3, gl.SHORT, 6, 0], shift: [3, gl.BYTE, 3, 6 * n], strip: [1, gl.UNSIGNED_BYTE, 1, 9 * n] };
  for (const [name, [items, kind, stride, start]] of Object.entries(parts)) {
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, items, kind, false, stride, start);
  }
  const at = (name) => gl.getUniformLocation(program, name);
  const rgb = view.dataset.colours.split(" ").flatMap((c) => [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16) / 255));
  gl.uniform3fv(at("colours"), rgb.concat(Array(24 - rgb.length).fill(0)));
  gl.uniform1f(at("step"), +view.dataset.step);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(1, 1, 1, 1);

  const eye = { azimuth: -0.5, height: 0.5, distance: 105, centre: [0, 0, 3] };
  const [moved, byHeight] = view.querySelectorAll("input");
  function draw() {
    const sharp = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * sharp);
    canvas.height = Math.round(canvas.clientHeight * sharp);
    gl.viewport(0, 0, canvas.width, canvas.height);
    const [ca, sa] = [Math.cos(eye.azimuth), Math.sin(eye.azimuth)], [ch, sh] = [Math.cos(eye.height), Math.sin(eye.height)];
    const f = 2.2, wide = canvas.width / canvas.height, near = 1, far = 2000;
    const a = (far + near) / (near - far), b = (2 * far * near) / (near - far), d = eye.distance;
    // rows: to the right, up on the screen, away from the eye (turned about up, then tilted)
    const right = [ca, sa, 0], up = [sa * -sh, ca * sh, ch], back = [sa * ch, -ca * ch, sh];
    const rows = [right.map((v) => (v * f) / wide), up.map((v) => v * f), back.map((v) => v * a), back.map((v) => -v)];
    const last = [0, 0, -d * a + b, d];
    gl.uniformMatrix4fv(at("turn"), false, [0, 1, 2].flatMap((k) => rows.map((row) => row[k])).concat(last));
    gl.uniform3fv(at("centre"), eye.centre);
    gl.uniform1f(at("t"), +moved.value);
    gl.uniform1f(at("size"), 300 * sharp);
    gl.uniform1f(at("byHeight"), byHeight.checked ? 1 : 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.POINTS, 0, n);
  }
  const soon = () => requestAnimationFrame(draw);
  const turn = (x, y) => {
    eye.azimuth -= x;
    eye.height = Math.min(1.57, Math.max(0, eye.height + y));
    soon();
  };
  const zoom = (by) => {
    eye.distance = Math.min(500, Math.max(8, eye.distance * by));
    soon();
  };
  const shift = (x, y) => {
    const s = eye.distance / 600, [c, n] = [Math.cos(eye.azimuth), Math.sin(eye.azimuth)];
    eye.centre[0] -= s * (x * c + y * n);
    eye.centre[1] -= s * (x * n - y * c);
    soon();
  };
  canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    if (!e.buttons) return;
    if (e.shiftKey) shift(e.movementX, e.movementY);
    else turn(e.movementX / 200, e.movementY / 200);
  });
  canvas.addEventListener("wheel", (e) => {
    if (document.activeElement !== canvas) return;
    e.preventDefault();
    zoom(Math.exp(e.deltaY / 800));
  }, { passive: false });
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  canvas.addEventListener("keydown", (e) => {
    if (keys[e.key]) turn(...keys[e.key]);
    else if (e.key === "+" || e.key === "-") zoom(e.key === "+" ? 0.8 : 1.25);
    else return;
    e.preventDefault();
  });
  view.querySelectorAll("button").forEach((b) => b.addEventListener("click", () => zoom(+b.dataset.zoom)));
  moved.addEventListener("input", soon);
  byHeight.addEventListener("input", soon);
  window.addEventListener("resize", soon);
  view.hidden = false;
  draw();
})();
