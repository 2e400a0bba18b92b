#!/usr/bin/env python3
"""The page in a real browser, against mock_gateway.mjs: pictures are compared, times are not.

    browser_test.py [unittest arguments]

Ends with 77 (skipped) where node, chromium, chromedriver or selenium is missing.
"""
import base64
import contextlib
import html
import http.server
import json
import math
import os
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.parse
import urllib.request
import zlib

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'support'))
import skips  # noqa: E402

try:
    from selenium import webdriver
    from selenium.common.exceptions import WebDriverException
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.remote.remote_connection import RemoteConnection
except ImportError:
    webdriver = None

HERE = os.path.dirname(os.path.abspath(__file__))
CLICK_MS = 500  # of clients/web/view/pointer.js
PATIENCE_S = 180  # a limit for waiting, far above what is needed; more than a minute beside three builds


def missing():
    names = [name for name in ('node', 'chromium', 'chromedriver') if shutil.which(name) is None]
    return names + (['python3-selenium'] if webdriver is None else [])


@contextlib.contextmanager
def size_of(browser, width, height, scale=1, is_touch=False):
    """A window of this size in CSS pixels, with so many device pixels for each."""
    browser.execute_cdp_cmd('Emulation.setDeviceMetricsOverride',
                            {'width': width, 'height': height, 'deviceScaleFactor': scale, 'mobile': is_touch})
    browser.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': is_touch, **({'maxTouchPoints': 2} if is_touch else {})})
    try:
        yield
    finally:
        browser.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})
        browser.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': False})


def decode_png(data):
    """Returns width, height and the rows of an 8-bit RGB or RGBA PNG as RGB tuples."""
    width, height, _, kind = struct.unpack('>IIBB', data[16:26])
    channels = {2: 3, 6: 4}[kind]
    at, packed = 8, b''
    while at < len(data):
        size, = struct.unpack('>I', data[at:at + 4])
        if data[at + 4:at + 8] == b'IDAT':
            packed += data[at + 8:at + 8 + size]
        at += 12 + size
    raw, stride, rows = zlib.decompress(packed), width * channels, []
    previous = bytearray(stride)
    for y in range(height):
        start = y * (stride + 1)
        method, row = raw[start], bytearray(raw[start + 1:start + 1 + stride])
        for i in range(stride):
            left = row[i - channels] if i >= channels else 0
            up, corner = previous[i], previous[i - channels] if i >= channels else 0
            if method == 1:
                row[i] = (row[i] + left) & 255
            elif method == 2:
                row[i] = (row[i] + up) & 255
            elif method == 3:
                row[i] = (row[i] + (left + up) // 2) & 255
            elif method == 4:
                p = left + up - corner
                best = min((abs(p - left), 0, left), (abs(p - up), 1, up), (abs(p - corner), 2, corner))[2]
                row[i] = (row[i] + best) & 255
        rows.append([tuple(row[channels * x:channels * x + 3]) for x in range(width)])
        previous = row
    return width, height, rows


class Gateway:
    def __init__(self):
        self.process = subprocess.Popen(['node', os.path.join(HERE, 'mock_gateway.mjs')], stdout=subprocess.PIPE, text=True)
        try:
            self.port = int(self.process.stdout.readline())
        except ValueError:
            self.stop()
            raise
        self.url = f'http://127.0.0.1:{self.port}/'

    token = None  # the mock requires it
    features = None  # it has them

    def control(self, **what):
        self.token = what.get('token', self.token)
        self.features = what.get('features', self.features)
        body = json.dumps(what).encode() if what else None
        with urllib.request.urlopen(urllib.request.Request(self.url + 'control', data=body), timeout=PATIENCE_S) as reply:
            return json.load(reply)

    def post(self, path, body):
        headers = {'Authorization': f'Bearer {self.token}'} if self.token else {}
        request = urllib.request.Request(self.url + path, data=json.dumps(body).encode(), headers=headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
            return reply.read()

    def stop(self):
        self.process.terminate()
        self.process.wait()
        self.process.stdout.close()


class PageTest(unittest.TestCase):
    QUERY = '?theme=dark&max-side=420'

    @classmethod
    def setUpClass(cls):
        cls.gateway = Gateway()
        cls.addClassCleanup(cls.gateway.stop)
        RemoteConnection.set_timeout(2 * PATIENCE_S)  # longer than what the driver waits for
        cls.browser = cls.start_browser()
        cls.addClassCleanup(cls.browser.quit)
        cls.browser.set_script_timeout(PATIENCE_S)

    @classmethod
    def start_browser(cls):
        """Starts Chromium, which may not begin to answer in time on a busy machine: then once more, with another profile."""
        for tries_left in (2, 1, 0):
            profile = tempfile.mkdtemp(prefix='isoscope-browser-')
            cls.addClassCleanup(shutil.rmtree, profile, ignore_errors=True)
            options = Options()
            options.binary_location = shutil.which('chromium')
            for argument in ('--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--force-device-scale-factor=1',
                             '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--window-size=1000,640',
                             f'--user-data-dir={profile}'):
                options.add_argument(argument)
            options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
            service = Service(shutil.which('chromedriver'))
            try:
                return webdriver.Chrome(service=service, options=options)
            except WebDriverException as error:
                with contextlib.suppress(Exception):
                    service.stop()
                if tries_left == 0:
                    raise
                print(f'Chromium did not start, trying again: {error.msg}', file=sys.stderr)

    def setUp(self):
        self.browser.get('about:blank')
        end = time.monotonic() + PATIENCE_S
        while self.gateway.control()['streams'] > 0:  # what the page before has sent comes no later
            self.assertLess(time.monotonic(), end, 'the page before keeps its connection')
            time.sleep(0.02)
        self.gateway.control(fail=None, mute=False, raw=None, refuse=False, token=None, name=None, steps=6,
                             features=['notes'], note=None, maxViewportPx=4096, mostPixels=None, hasWebp=False, hidden=None, refine=None,
                             levels=0, unresolved=0, reset=True)

    def open(self, hash_='', query=None):
        self.browser.get('about:blank')
        self.browser.get(self.gateway.url + (self.QUERY if query is None else query) + hash_)

    def open_and_wait(self, *args, **kwargs):
        self.open(*args, **kwargs)
        self.until_open()

    def js(self, script, *args):
        return self.browser.execute_script(script, *args)

    def until(self, condition):
        end = time.monotonic() + PATIENCE_S
        while not self.js(f'return Boolean(window.isoscope && ({condition}))'):
            if time.monotonic() > end:
                notice = self.js('return window.isoscope ? JSON.stringify(isoscope.view.stats()) : document.body.innerText')
                self.fail(f'never came: {condition}; the view says {notice}; '
                          f'log: {self.browser.get_log("browser")}')
            time.sleep(0.02)

    def until_exact(self):
        self.until('isoscope.view.isExact')

    def until_open(self):
        """Waits until the page shows all that its address says: the first exact picture may come before the dataset and the histogram do."""
        # Asked for as soon as all is known, where the server has notes.
        added = 'withNotes' if 'notes' in (self.gateway.features or []) else 'backgroundColor'
        self.until(f'isoscope.view.dataset && isoscope.view.state.{added}')
        self.until_drawn()
        self.until_exact()

    def until_drawn(self):
        """Waits until the controls are drawn, and the view has the size that they leave."""
        self.browser.execute_async_script('const [done] = arguments; requestAnimationFrame(() => requestAnimationFrame(() => done()));')

    def until_still(self, read_value, quiet_s=0.5):
        """Waits until a value has not changed for some time, and returns it: what was under way has come."""
        def read():
            # Behind what the page has sent before: a browser that stands still for a while is no silence.
            self.browser.execute_async_script(
                'const [done] = arguments; setTimeout(() => fetch("control").then((answer) => answer.text()).then(done));')
            return read_value()
        end = time.monotonic() + PATIENCE_S
        value, since = read(), time.monotonic()
        while time.monotonic() - since < quiet_s:
            self.assertLess(time.monotonic(), end, f'it never rests: {value}')
            time.sleep(0.05)
            if (new := read()) != value:
                value, since = new, time.monotonic()
        return value

    def until_kept(self):
        """Waits until the view has rested: it is an entry of undo."""
        self.until('isoscope.undo.isAt(isoscope.view.getState())')

    def notice(self):
        return self.js('return isoscope.view.stats().notice')

    def picture(self):
        """Returns the view's present picture, without the overlay, in the browser's own pixels."""
        url = self.js('''const { picture } = isoscope.view.loop; const out = document.createElement('canvas');
            out.width = picture.width; out.height = picture.height; picture.screen.draw(isoscope.view.camera);
            const context = out.getContext('2d'); context.drawImage(picture.screen.canvas, 0, 0, out.width, out.height);
            return out.toDataURL('image/png');''')
        return decode_png(base64.b64decode(url.split(',')[1]))

    def asked_over_http(self):
        """The request of the picture that the view shows. A picture over HTTP has no notes and counts."""
        return self.js('const { withNotes, withUnresolvedCount, ...state } = isoscope.view.getState(); return { ...state, '
                       'viewport: { widthPx: isoscope.view.loop.picture.width, heightPx: isoscope.view.loop.picture.height } }')

    def reference(self):
        """The server's own picture of the state that the view is in."""
        state = self.asked_over_http()
        return decode_png(self.gateway.post(f'v1/datasets/{state["dataset"]}/render', state))

    @staticmethod
    def share_of_equal(a, b, tolerance=0):
        assert a[:2] == b[:2], f'{a[:2]} and {b[:2]}'
        pairs = [(p, q) for row, other in zip(a[2], b[2]) for p, q in zip(row, other)]
        return sum(all(abs(i - j) <= tolerance for i, j in zip(p, q)) for p, q in pairs) / len(pairs)

    def click(self, element, x, y, is_double=False):
        """Clicks at a place from the element's middle, again where a busy machine was too slow for a click of people."""
        for _ in range(20):
            self.js('''window.clicked = { doubles: 0 };
                window.note = (event) => { if (event.type === 'dblclick') clicked.doubles += 1; else clicked[event.type] = event.timeStamp; };
                for (const type of ['pointerdown', 'pointerup', 'dblclick']) window.addEventListener(type, note, true);''')
            actions = ActionChains(self.browser).move_to_element_with_offset(element, x, y)
            (actions.double_click() if is_double else actions.click()).perform()
            clicked = self.js("for (const type of ['pointerdown', 'pointerup', 'dblclick']) window.removeEventListener(type, note, true); return clicked")
            if clicked['doubles'] if is_double else clicked['pointerup'] - clicked['pointerdown'] < CLICK_MS:
                return
        self.fail(f'never a click: {clicked}')

    def drag(self, dx, dy, steps=4, is_seen=False):
        """is_seen: with a frame of the moving view, which a busy machine may leave out."""
        actions = ActionChains(self.browser, duration=10).move_to_element(self.browser.find_element(By.ID, 'view'))
        actions = actions.click_and_hold()
        for _ in range(steps):
            actions = actions.move_by_offset(dx // steps, dy // steps)
        if is_seen:
            self.gateway.control(mute=True)
            actions.perform()
            self.until('!isoscope.view.loop.stream.isDirty')
            shown, sequence = self.js('return [isoscope.view.stats().framesShown, isoscope.view.loop.stream.sequence]')
            self.gateway.control(answer=sequence)  # without the exact picture
            self.until(f'isoscope.view.stats().framesShown > {shown}')
            self.gateway.control(mute=False)
            actions = ActionChains(self.browser)
        actions.release().perform()


class PictureTest(PageTest):
    def test_the_picture_at_rest_is_the_server_s_in_every_pixel(self):
        self.open_and_wait()
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        self.assertEqual('', self.notice())

    def test_without_a_link_the_suggested_isovalue_of_the_first_dataset_shows(self):
        self.open_and_wait()
        state = self.js('return isoscope.view.getState()')
        self.assertEqual(('ball', 40), (state['dataset'], state['surfaces'][0]['isovalue']))
        self.assertIn('101 × 101 × 101 uint8', self.browser.find_element(By.ID, 'facts').get_attribute('textContent'))

    def test_without_a_link_the_server_chooses_the_camera(self):
        self.open_and_wait()
        first = self.gateway.control()['first']['frame']
        self.assertEqual(([{'isovalue': 40}], None, None), ([{'isovalue': one['isovalue']} for one in first['surfaces']],
                                                           first.get('camera'), first.get('cameraFit')))
        # The mock's default camera: of the whole volume.
        self.assertEqual(self.js('return import("./isoscope-view.js").then((m) => m.defaultCamera(m.boxOfDataset(isoscope.view.dataset)))'),
                         self.js('return isoscope.view.camera'))

    def test_the_first_look_is_asked_for_where_the_coordinator_knows_it_and_is_in_the_link(self):
        self.gateway.control(features=['notes', 'fit_cells'])
        self.open_and_wait()
        first = self.gateway.control()['first']['frame']
        self.assertEqual((None, 'CAMERA_FIT_CELLS', 4), (first.get('camera'), first.get('cameraFit'), first.get('samples')))
        self.assertEqual([0.1], [one['material']['specular'] for one in first['surfaces']])
        state = self.js('return isoscope.view.getState()')
        self.assertEqual((True, None), ('eye' in state['camera'], state.get('cameraFit')), 'the answer has the camera')
        self.until("location.hash.includes('material=soft') && location.hash.includes('samples=4') && location.hash.includes('eye=')")
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        # A new surface has the material of the others.
        self.js('''import('./page-view.js').then(({ change, shown }) => change({ surfaces: [...shown.state.surfaces, { isovalue: 60 }] }));''')
        self.until('isoscope.view.state.surfaces.length === 2 && isoscope.view.state.surfaces[1].material')

    def test_fit_keeps_the_direction_and_home_is_the_first_look_again(self):
        self.gateway.control(features=['notes', 'fit_cells'])
        self.open_and_wait()
        direction = '(() => { const { eye, target } = isoscope.view.camera; const d = eye.map((v, i) => v - target[i]); return d.map((v) => v / Math.hypot(...d)); })()'
        first = self.js(f'return {direction}')
        self.drag(120, 40)
        self.until_exact()
        turned = self.js(f'return {direction}')
        self.assertGreater(math.dist(first, turned), 0.1)
        ActionChains(self.browser).send_keys('+').send_keys('0').perform()
        self.until("isoscope.view.isExact && !isoscope.view.state.cameraFit")
        self.assertLess(math.dist(turned, self.js(f'return {direction}')), 1e-6)
        ActionChains(self.browser).send_keys(Keys.HOME).perform()
        self.until("isoscope.view.isExact && !isoscope.view.state.cameraFit")
        self.assertLess(math.dist(first, self.js(f'return {direction}')), 1e-6)

    def test_a_drag_turns_camera_and_picture_and_rests_exact(self):
        self.open_and_wait()
        before, eye = self.picture(), self.js('return isoscope.view.camera.eye')
        self.drag(120, 40, is_seen=True)
        self.until_exact()
        after = self.js('return isoscope.view.camera.eye')
        self.assertGreater(math.dist(eye, after), 5)
        self.assertLess(self.share_of_equal(self.picture(), before), 0.99)
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        stats = self.js('return isoscope.view.stats()')
        self.assertGreater(stats['framesShown'], stats['exactShown'], 'no moving frame was shown')

    def test_moving_frames_come_before_the_exact_one_and_all_are_acknowledged(self):
        self.open_and_wait()
        self.drag(60, 60, steps=12, is_seen=True)
        self.until_exact()
        shown = self.until_still(lambda: self.gateway.control()['shown'])
        frames = self.js('const s = isoscope.view.stats(); return s.framesShown + s.framesDropped')
        self.assertEqual(list(range(1, frames + 1)), sorted(shown), 'not each frame was acknowledged once')

    def test_shift_drag_pans_wheel_zooms_to_the_pointer_and_keys_turn(self):
        self.open_and_wait()
        view = self.browser.find_element(By.ID, 'view')
        target = self.js('return isoscope.view.camera.target')
        ActionChains(self.browser, duration=10).key_down(Keys.SHIFT).perform()
        self.drag(80, 0)
        ActionChains(self.browser).key_up(Keys.SHIFT).perform()
        self.assertGreater(math.dist(target, self.js('return isoscope.view.camera.target')), 1)
        self.until_exact()
        distance = 'Math.hypot(...isoscope.view.camera.eye.map((v, i) => v - isoscope.view.camera.target[i]))'
        far = self.js(f'return {distance}')
        ActionChains(self.browser).scroll_from_origin(ScrollOrigin.from_element(view), 0, -240).perform()
        self.until(f'{distance} < {far * 0.95}')
        self.until_exact()
        eye = self.js('return isoscope.view.camera.eye')
        ActionChains(self.browser).send_keys(Keys.ARROW_LEFT).send_keys('b').perform()
        self.until(f'isoscope.view.camera.eye[0] !== {eye[0]} && isoscope.view.decorations.box')
        self.until_exact()
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_two_fingers_zoom_and_what_lies_between_them_stays(self):
        self.open_and_wait()
        distance = 'Math.hypot(...isoscope.view.camera.eye.map((v, i) => v - isoscope.view.camera.target[i]))'
        far = self.js(f'return {distance}')
        self.js('''const el = isoscope.view.root; const box = el.getBoundingClientRect();
            const middle = [box.x + box.width / 2, box.y + box.height / 2];
            const send = (type, pointerId, dx) => el.dispatchEvent(new PointerEvent(type, { pointerId, pointerType: 'touch',
              clientX: middle[0] + dx, clientY: middle[1], buttons: 1, bubbles: true }));
            send('pointerdown', 1, -50); send('pointerdown', 2, 50);
            for (let i = 1; i <= 10; ++i) { send('pointermove', 1, -50 - 5 * i); send('pointermove', 2, 50 + 5 * i); }
            send('pointerup', 1, -100); send('pointerup', 2, 100);''')
        self.until_exact()
        near = self.js(f'return {distance}')
        self.assertTrue(0.4 < near / far < 0.75, f'{near} of {far}')
        self.assertEqual([], self.js('return isoscope.view.loop.overlay.pins'), 'fingers that move pick nothing')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_a_named_view_fits_the_surface_and_those_of_a_patient_come_with_its_frame(self):
        self.open_and_wait('#dataset=patient&surface=40')
        names = [button.get_attribute('textContent') for button in self.browser.find_elements(By.CSS_SELECTOR, '#views button')]
        self.assertEqual(['Anterior', 'Posterior', 'Left', 'Right', 'Superior', 'Inferior', 'Fit'], names)
        self.browser.find_element(By.CSS_SELECTOR, '[data-view=anterior]').click()
        self.until('isoscope.view.isExact && !isoscope.view.state.cameraFit && isoscope.view.camera.up[2] === 1')
        camera = self.js('return isoscope.view.camera')
        self.assertLess(camera['eye'][1], camera['target'][1], 'anterior is -y of LPS')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_every_bitmap_is_closed(self):
        self.open_and_wait()
        # A busy browser drops frames also before it decodes them.
        self.js('''window.undecoded = 0; const { frames } = isoscope.view.loop; const receive = frames.receive.bind(frames);
            frames.receive = (message) => { undecoded += message.kind === 'dropped' ? 1 : 0; receive(message); };''')
        for _ in range(3):
            self.drag(80, -30, steps=10, is_seen=True)
        self.until_exact()
        stats = self.until_still(lambda: self.js(
            'const { bitmapsMade, bitmapsOpen, framesShown, framesDropped } = isoscope.view.stats(); '
            'return { bitmapsMade, bitmapsOpen, framesShown, framesDropped, undecoded }'))
        self.assertGreater(stats['bitmapsMade'], 3)
        self.assertEqual(0, stats['bitmapsOpen'])
        self.assertEqual(stats['bitmapsMade'] + stats['undecoded'], stats['framesShown'] + stats['framesDropped'])
        self.js('isoscope.view.destroy()')
        self.assertEqual(0, self.js('return document.querySelectorAll(".isoscope-view").length'))
        self.assertEqual(0, self.js('return isoscope.view.stats().bitmapsOpen'))

    def test_the_page_obeys_its_content_security_policy_and_logs_no_error(self):
        self.browser.get_log('browser')  # of the pages before
        self.open_and_wait()
        errors = [entry for entry in self.browser.get_log('browser') if entry['level'] == 'SEVERE']
        self.assertEqual([], [entry for entry in errors if 'favicon' not in entry['message']])
        self.assertTrue(self.js('return isoscope.view.stats().isInWorker'))


class ControlTest(PageTest):
    # A pixel of what lies over the picture, from the view's middle.
    PIXEL = '((dx, dy) => { const c = isoscope.view.loop.overlay.scene; return c.width === 0 ? [0, 0, 0, 0] : ' \
        '[...c.getContext("2d").getImageData(c.width / 2 + dx, c.height / 2 + dy, 1, 1).data]; })'

    def test_a_drag_leaves_the_controls_alone_and_a_change_of_theirs_draws_them(self):
        self.open_and_wait()
        self.js('''window.curve = document.getElementById("chart").firstChild;
            window.handle = document.querySelector("#histogram [role=slider]"); window.row = document.querySelector("#surfaces li");''')
        self.drag(120, 40, steps=12)
        self.until_exact()
        self.assertTrue(self.js('return curve === document.getElementById("chart").firstChild'))
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 62 }] })')
        self.until('isoscope.view.isExact && document.querySelector("#surfaces input[type=number]").value === "62"')
        self.assertFalse(self.js('return curve === document.getElementById("chart").firstChild'))
        self.assertTrue(self.js('return handle === document.querySelector("#histogram [role=slider]")'),
                        'a handle that may have the focus was replaced')
        self.assertTrue(self.js('return row === document.querySelector("#surfaces li")'), 'a control under the pointer was replaced')

    def test_axes_and_scale_bar_are_small_and_turn_with_the_picture(self):
        self.open_and_wait()
        image = 'isoscope.view.loop.overlay.axes.toDataURL()'
        before, size = self.js(f'return {image}'), self.js('return [isoscope.view.loop.overlay.axes, isoscope.view.loop.overlay.scaleBar].map((c) => [c.width, c.height])')
        self.assertLess(max(side for pair in size for side in pair), 200)
        self.assertTrue(self.js('return isoscope.view.loop.overlay.scene.hidden'))
        self.drag(90, 30)
        self.until_exact()
        self.assertNotEqual(before, self.js(f'return {image}'))
        self.js('isoscope.view.decorate({ axes: false, box: true })')
        self.until('isoscope.view.loop.overlay.axes.hidden && !isoscope.view.loop.overlay.scene.hidden')

    def test_dragging_the_line_of_the_histogram_changes_the_surface(self):
        self.open_and_wait()
        before = self.picture()
        handle = self.browser.find_element(By.CSS_SELECTOR, '#histogram .handle circle')
        ActionChains(self.browser, duration=10).move_to_element(handle).click_and_hold().move_by_offset(40, 0) \
            .move_by_offset(30, 0).release().perform()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].isovalue > 50')
        self.assertLess(self.share_of_equal(self.picture(), before), 0.99)
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        field = self.browser.find_element(By.CSS_SELECTOR, '#surfaces input[type=number]').get_attribute('value')
        self.assertEqual(self.js('return isoscope.view.state.surfaces[0].isovalue'), float(field))

    def test_a_surface_is_added_by_a_double_click_and_removed(self):
        self.open_and_wait()
        chart = self.browser.find_element(By.ID, 'histogram')
        self.click(chart, 80, 0, is_double=True)
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 2')
        outer, inner = self.js('return isoscope.view.state.surfaces')
        self.assertGreater(inner['isovalue'], outer['isovalue'])
        self.assertEqual((0.4, 1), (outer['color']['alpha'], inner['color']['alpha']))
        self.browser.find_elements(By.CSS_SELECTOR, '#surfaces .remove')[0].click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 1')
        self.assertEqual(inner['isovalue'], self.js('return isoscope.view.state.surfaces[0].isovalue'))

    def test_the_clip_box_cuts_the_picture_and_clearing_it_brings_all_back(self):
        self.open_and_wait()
        before = self.picture()
        bar = self.browser.find_element(By.CSS_SELECTOR, '#clip .slider')
        self.js('arguments[0].scrollIntoView()', bar)
        thumb = self.browser.find_element(By.CSS_SELECTOR, '#clip [data-axis=x][data-end=high]')
        ActionChains(self.browser, duration=10).move_to_element(thumb).click_and_hold() \
            .move_by_offset(-bar.size['width'] // 2, 0).release().perform()
        self.until('isoscope.view.isExact && isoscope.view.state.clip?.box')
        self.assertLess(self.js('return isoscope.view.state.clip.box.max.x'), 70)
        self.js('''const caps = document.getElementById('caps'); caps.value = 'slice'; caps.dispatchEvent(new Event('change'));''')
        self.until_exact()
        self.assertEqual({'colorMap': 'COLOR_MAP_GREY'}, self.gateway.control()['last']['frame']['caps'])
        self.assertLess(self.share_of_equal(self.picture(), before), 0.99)
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        self.browser.find_element(By.ID, 'clear-clip').click()
        self.until('isoscope.view.isExact && !isoscope.view.state.clip && !isoscope.view.state.caps')
        self.assertEqual(1, self.share_of_equal(self.picture(), before))

    def choose(self, id_, value):
        self.js('''const element = document.getElementById(arguments[0]); element.value = arguments[1];
                element.dispatchEvent(new Event('change'));''', id_, value)

    def test_colours_rescale_to_what_is_visible_and_links_keep_the_numbers(self):
        self.gateway.control(features=['notes', 'color_ranges'])
        self.open_and_wait()
        self.choose('quantity', 'z')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy')
        self.js('document.getElementById("range-visible").click()')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy.range?.max === 7.988')
        asked = self.gateway.control()['renders'][-1]
        self.assertEqual({'source': 'SOURCE_VISIBLE'}, asked['surfaces'][0]['colorBy']['range'])
        self.assertEqual(self.js('return [isoscope.view.loop.picture.width, isoscope.view.loop.picture.height]'),
                         [asked['viewport']['widthPx'], asked['viewport']['heightPx']])
        self.assertNotIn('withNotes', asked)
        self.until('location.hash.includes("color-by=z:viridis:0.123,7.988")')

    def test_a_surface_that_does_not_show_counts_for_no_visible_range(self):
        self.gateway.control(features=['notes', 'color_ranges'], hidden=1)
        # The second surface is behind the first, and the third is clear.
        self.open_and_wait('#dataset=ball&surface=40:1,1,1&surface=50:1,0,0&surface=60:0,1,0:0&color-by=z:viridis')
        self.js('document.getElementById("range-visible").click()')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy.range?.max === 7.988')
        self.assertEqual(3 * [{'min': 0.123, 'max': 7.988}], self.js('return isoscope.view.state.surfaces.map(({ colorBy }) => colorBy.range)'))
        self.assertEqual(['QUANTITY_POSITION_Z', 'QUANTITY_POSITION_X'],
                         [asked['surfaces'][1]['colorBy']['quantity'] for asked in self.gateway.control()['renders'][-2:]])
        # Where all show, one answer is enough.
        self.gateway.control(hidden=None, reset=True)
        self.js('document.getElementById("range-visible").click()')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy.range?.min === -0.877')

    def test_cuts_that_show_samples_have_a_window(self):
        self.gateway.control(features=['notes', 'color_ranges'])
        self.open_and_wait()
        self.browser.find_element(By.ID, 'add-plane').click()
        self.until('isoscope.view.isExact && isoscope.view.state.clip')
        self.choose('caps', 'slice')
        self.until_exact()
        self.assertEqual({'colorMap': 'COLOR_MAP_GREY', 'range': {'percentiles': {'low': 2, 'high': 98}}},
                         self.gateway.control()['last']['frame']['caps'])
        self.until('location.hash.includes("caps=grey&cap-window=2,98")')
        # In one step: a field that is drawn meanwhile has the value of the state.
        self.js('''document.getElementById('window-low').value = '10'; const high = document.getElementById('window-high');
            high.value = '40'; high.dispatchEvent(new Event('change'));''')
        self.until('isoscope.view.isExact && isoscope.view.state.caps.range?.max === 40')
        self.assertEqual({'min': 10, 'max': 40}, self.gateway.control()['last']['frame']['caps']['range'])

    def test_an_older_coordinator_is_asked_for_no_range(self):
        self.open_and_wait()
        self.assertTrue(self.js('return document.getElementById("range-visible").hidden'))
        self.browser.find_element(By.ID, 'add-plane').click()
        self.until('isoscope.view.isExact && isoscope.view.state.clip')
        self.choose('caps', 'slice')
        self.until_exact()
        self.assertEqual({'colorMap': 'COLOR_MAP_GREY'}, self.gateway.control()['last']['frame']['caps'])

    def test_a_clip_plane_is_added_moved_flipped_and_removed(self):
        self.open_and_wait()
        before = self.picture()
        self.js('document.getElementById("add-plane").click()')
        self.until('isoscope.view.isExact && isoscope.view.state.clip?.halfSpaces.length === 1')
        self.assertLess(self.share_of_equal(self.picture(), before), 0.999)
        normal = self.js('return isoscope.view.state.clip.halfSpaces[0].normal')
        offset = self.js('return isoscope.view.state.clip.halfSpaces[0].offset')
        self.assertNotEqual(0, offset)
        self.js('document.querySelector("#planes .small").click()')
        self.until('isoscope.view.isExact')
        self.assertEqual(-normal['z'], self.js('return isoscope.view.state.clip.halfSpaces[0].normal.z'))
        self.assertEqual(-offset, self.js('return isoscope.view.state.clip.halfSpaces[0].offset'))
        self.js('document.querySelector("#planes .remove").click()')
        self.until('isoscope.view.isExact && !isoscope.view.state.clip')

    def test_a_click_picks_a_point_and_two_give_their_distance(self):
        self.open_and_wait()
        view = self.browser.find_element(By.ID, 'view')
        self.click(view, 10, 10)
        self.until('isoscope.view.loop.overlay.pins.length === 1')
        self.click(view, -40, 20)
        self.until('isoscope.view.loop.overlay.pins.length === 2')
        a, b = (pin['position'] for pin in self.js('return isoscope.view.loop.overlay.pins'))
        # On the ball of the isovalue 40.
        for point in (a, b):
            self.assertAlmostEqual(28 * 1.2, math.dist(point, (50, 50, 50)), places=6)
        text = self.browser.find_element(By.ID, 'points').text
        self.assertIn(f'{math.dist(a, b):.5g}', text)
        self.assertNotIn('block', text)
        # The pins lie over the picture, where the clicks were, and leave it as it is.
        self.until(f'{self.PIXEL}(10, 10)[3] === 255 && {self.PIXEL}(-40, 20)[3] === 255')
        for x, y in ((10, 10), (-40, 20)):
            self.assertEqual([255, 180, 84], self.js(f'return {self.PIXEL}(arguments[0], arguments[1])', x, y)[:3])
        self.assertEqual(0, self.js(f'return {self.PIXEL}(60, -60)')[3])
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        self.click(view, -view.size['width'] // 2 + 8, 0)
        self.until('isoscope.view.loop.overlay.pins.length === 0 && isoscope.view.loop.overlay.scene.hidden')

    def test_colour_by_sends_quantity_and_map_and_shows_the_legend(self):
        self.open_and_wait()
        self.js('''const q = document.getElementById('quantity'); q.value = 'z'; q.dispatchEvent(new Event('change'));''')
        self.until('isoscope.view.isExact && !document.getElementById("legend").hidden')
        self.assertEqual({'quantity': 'QUANTITY_POSITION_Z', 'colorMap': 'COLOR_MAP_VIRIDIS'},
                         self.js('return isoscope.view.state.surfaces[0].colorBy'))
        self.assertIn('position z', self.browser.find_element(By.ID, 'legend').text)

    def test_the_toggles_of_light_reach_the_server(self):
        self.open_and_wait()
        self.js('''for (const id of ['ambient-occlusion', 'silhouette']) document.getElementById(id).click();
            for (const [id, value] of [['samples', '4'], ['lights', 'studio']]) {
              const element = document.getElementById(id); element.value = value;
              element.dispatchEvent(new Event('change')); }''')
        self.until_exact()
        frame = self.gateway.control()['last']['frame']
        self.assertEqual((4, 3, {'radiusPx': 32}, {'widthPx': 2}), (frame['samples'], len(frame['lights']),
                         frame['ambientOcclusion'], frame['silhouette']))

    def test_a_download_asks_for_the_size_and_the_state_of_the_view(self):
        self.open_and_wait()
        self.browser.find_element(By.ID, 'save').click()
        self.assertIn('isoscope render --server', self.browser.find_element(By.ID, 'command').text)
        self.js('''for (const [id, value] of [['width', 90], ['height', 60]]) {
              const field = document.getElementById(id); field.value = value; field.dispatchEvent(new Event('input')); }
            document.getElementById('transparent').click();''')
        # The command is that of the picture that is downloaded.
        command = self.browser.find_element(By.ID, 'command').text
        for words in ('--width 90', '--height 60', '--samples 4', '--background 0,0,0,0'):
            self.assertIn(words, command)
        self.js("document.getElementById('save-png').click()")
        self.until('/B$/.test(document.getElementById("save-note").textContent)')
        render = self.gateway.control()['renders'][-1]
        self.assertEqual(({'widthPx': 90, 'heightPx': 60}, 4), (render['viewport'], render['samples']))
        self.assertEqual(0, render['backgroundColor']['alpha'])
        self.assertEqual(self.js('return isoscope.view.getState().camera'), render['camera'])


class LabelTest(PageTest):
    """The dataset organs has a sphere for each of its labels."""

    def labels(self):
        return self.js('return isoscope.view.state.surfaces.map((one) => one.labels ?? one.isovalue)')

    def check(self, value):
        self.browser.find_element(By.CSS_SELECTOR, f'#label-list [data-label="{value}"] input[type=checkbox]').click()

    def until_labels(self, labels):
        self.until(f'isoscope.view.isExact && JSON.stringify(isoscope.view.state.surfaces.map((one) => one.labels ?? one.isovalue)) === {json.dumps(json.dumps(labels, separators=(",", ":")))}')

    def test_each_label_is_shown_and_hidden_by_its_box_in_its_colour(self):
        self.open_and_wait('#dataset=organs&surface=40')
        self.until('!document.getElementById("labels").hidden')
        self.assertEqual(['left lung', 'right lung', '<b>heart</b>'],
                         [name.text for name in self.browser.find_elements(By.CSS_SELECTOR, '#label-list .name')])
        self.check(2)
        self.until_labels([40, [2]])
        self.browser.find_element(By.CSS_SELECTOR, '#surfaces .remove').click()
        self.until_labels([[2]])
        self.check(1)
        self.until_labels([[2], [1]])
        self.assertEqual({'red': 1, 'green': 0, 'blue': 0, 'alpha': 1}, self.js('return isoscope.view.state.surfaces[1].color'))
        self.assertEqual(['#ff0000', '#d0dc51', '#ec83d4'], self.js(
            'return [...document.querySelectorAll("#label-list input[type=color]")].map((one) => one.value)'))
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        self.until('/labels=2&labels=1&/.test(location.hash + "&")')  # with the colours of the dataset
        both = self.picture()
        self.browser.refresh()
        self.until_open()
        self.until('document.querySelectorAll("#label-list :checked").length === 2')
        self.assertEqual(1, self.share_of_equal(self.picture(), both))
        self.check(2)
        self.until_labels([[1]])
        self.assertEqual([True, False, False], self.js(
            'return [...document.querySelectorAll("#label-list input[type=checkbox]")].map((one) => one.checked)'))

    def test_all_and_none_and_the_last_box_leave_a_picture_that_can_be_asked_for(self):
        self.open_and_wait('#dataset=organs&surface=40')
        self.until('!document.getElementById("labels").hidden')
        self.browser.find_element(By.ID, 'labels-all').click()
        self.until_labels([[1], [2], [3]])
        self.assertEqual(0, len(self.browser.find_elements(By.CSS_SELECTOR, '#surfaces li, #histogram .handle')))
        self.browser.find_element(By.ID, 'labels-none').click()
        self.until_labels([[-1]])
        self.assertEqual(1, len({pixel for row in self.picture()[2] for pixel in row}))
        self.assertEqual(0, len(self.browser.find_elements(By.CSS_SELECTOR, '#surfaces li, #label-list :checked')))
        self.check(3)
        self.until_labels([[3]])
        self.check(3)
        self.until_labels([[-1]])
        self.browser.find_element(By.ID, 'add').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 1 && isoscope.view.state.surfaces[0].isovalue > 0')

    def test_a_set_is_one_surface_with_its_names_and_a_wrong_one_is_said(self):
        self.open_and_wait('#dataset=organs&label=1')
        self.until('!document.getElementById("labels").hidden')
        field = self.browser.find_element(By.ID, 'label-set')
        field.send_keys('Right lung,3', Keys.ENTER)
        self.until_labels([[1], [2, 3]])
        self.assertEqual('right lung, <b>heart</b>', self.browser.find_element(By.CSS_SELECTOR, '#surfaces .name').text)
        self.js("""const opacity = document.querySelector('#surfaces input[type=range]'); opacity.value = '0.5';
            opacity.dispatchEvent(new Event('input'));""")
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[1].color.alpha === 0.5')
        field.send_keys('lnug', Keys.ENTER)
        self.until('/A set of labels has values/.test(document.getElementById("toast").textContent)')
        self.assertEqual([[1], [2, 3]], self.labels())
        self.browser.find_element(By.CSS_SELECTOR, '#surfaces .remove').click()
        self.until_labels([[1]])

    def test_a_point_has_the_name_of_its_label(self):
        self.open_and_wait('#dataset=organs&label=3')
        self.until('isoscope.view.state.surfaces[0].color.red > 0.9')
        camera = self.js('return isoscope.view.camera')
        self.js('isoscope.view.setCamera({ ...arguments[0], target: [75, 50, 50] })', camera)
        self.until_exact()
        view = self.browser.find_element(By.ID, 'view')
        self.click(view, 3, 3)
        self.until('isoscope.view.loop.overlay.pins.length === 1')
        self.assertEqual('<b>heart</b> (3)', self.browser.find_element(By.CSS_SELECTOR, '#points dd.label').text)
        self.assertEqual('3', self.js('return document.querySelector("#label-list .chosen").dataset.label'))
        self.assertTrue(self.browser.find_element(By.ID, 'label-only').is_displayed())

    def test_a_segmentation_opens_as_labels_and_a_chosen_one_is_shown_alone_hidden_and_highlighted(self):
        self.open_and_wait('#dataset=organs')
        self.until_labels([[1], [2], [3]])
        alphas = 'isoscope.view.state.surfaces.map((one) => one.color.alpha).join()'
        self.assertFalse(self.browser.find_element(By.ID, 'label-actions').is_displayed())
        self.browser.find_element(By.CSS_SELECTOR, '#label-list [data-label="2"] .name').click()
        self.assertEqual('right lung', self.browser.find_element(By.CSS_SELECTOR, '#label-actions .name').text)
        self.browser.find_element(By.ID, 'label-only').click()
        self.until_labels([[2]])
        self.until('/&labels=2&/.test(location.hash)')
        self.browser.find_element(By.ID, 'labels-all').click()
        self.until_labels([[1], [2], [3]])
        self.browser.find_element(By.ID, 'label-highlight').click()
        self.until(f'isoscope.view.isExact && {alphas} === "0.15,1,0.15"')
        self.assertEqual('true', self.browser.find_element(By.ID, 'label-highlight').get_attribute('aria-pressed'))
        self.browser.find_element(By.ID, 'label-highlight').click()
        self.until(f'isoscope.view.isExact && {alphas} === "1,1,1"')
        self.browser.find_element(By.ID, 'label-hide').click()
        self.until_labels([[1], [3]])
        self.assertFalse(self.browser.find_element(By.ID, 'label-highlight').is_enabled())
        self.browser.find_element(By.CSS_SELECTOR, '#label-list [data-label="2"] .name').click()
        self.assertFalse(self.browser.find_element(By.ID, 'label-actions').is_displayed())

    def test_labels_are_smooth_together_also_in_a_link(self):
        self.gateway.control(features=['notes', 'smooth_labels'])
        self.open_and_wait('#dataset=organs&label=1&label=2')
        smooth = self.browser.find_element(By.ID, 'labels-smooth')
        self.until('!document.getElementById("smooth-switch").hidden')
        smooth.click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.every((one) => one.smoothLabels)')
        self.check(3)
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 3 && isoscope.view.state.surfaces[2].smoothLabels')
        self.until('/smooth-labels=/.test(location.hash)')
        self.browser.refresh()
        self.until_open()
        self.until('document.getElementById("labels-smooth").checked')
        self.browser.find_element(By.ID, 'labels-smooth').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.every((one) => !one.smoothLabels)')

    def test_without_labels_there_is_no_list_of_them_until_a_link_has_some(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.assertTrue(self.js('return document.getElementById("labels").hidden'))
        self.open_and_wait('#dataset=ball&surface=40&label=7')
        self.until('!document.getElementById("labels").hidden')
        self.until('document.querySelector("#surfaces .name")?.textContent === "label 7"')


class SeriesTest(PageTest):
    STEP = 'isoscope.view.state.selection?.timeStep'
    IS_RESTING = 'document.getElementById("play").getAttribute("aria-label") === "Play"'
    RECORD = '''window.steps = []; isoscope.view.addEventListener('frame', (event) => {
        const step = event.detail.header.frame.selection.timeStep ?? 0; if (steps.at(-1) !== step) steps.push(step); });
        isoscope.view.root.focus();'''

    def by_id(self, name):
        return self.browser.find_element(By.ID, name)

    def is_shown(self, name):
        return self.js('return !document.getElementById(arguments[0]).hidden', name)

    def choose(self, menu, value):
        self.js('const menu = document.getElementById(arguments[0]); menu.value = arguments[1]; '
                'menu.dispatchEvent(new Event("change"))', menu, value)

    def until_step(self, step):
        self.until(f'isoscope.view.isExact && {self.STEP} === {step}')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_a_dataset_of_one_field_has_neither_menu_nor_time_bar(self):
        self.open_and_wait()
        self.assertFalse(self.is_shown('field-picker') or self.is_shown('timeline') or self.is_shown('field-quantities'))
        self.js('isoscope.view.root.focus()')
        ActionChains(self.browser).send_keys(']').send_keys(' ').perform()
        self.assertIsNone(self.js('return isoscope.view.getState().selection ?? null'))
        self.open_and_wait('#dataset=ball&surface=40&field=pressure&step=2&color-by=heat')
        # Which may end before the picture is there.
        self.until('/Field and time of this link were left out/.test(document.getElementById("toast").textContent)')

    def test_without_a_choice_the_last_step_of_the_first_field_shows(self):
        self.open_and_wait('#dataset=flow')
        self.until('document.getElementById("step").max === "5"')
        self.assertTrue(self.is_shown('field-picker') and self.is_shown('timeline'))
        self.assertEqual(('pressure', '5'), (self.by_id('field').get_attribute('value'), self.by_id('step').get_attribute('value')))
        self.assertEqual('1.25 s · step 5 (6 of 6)', self.by_id('time').text)
        self.assertIn('float32 · 0 to 100 Pa', self.by_id('facts').get_attribute('textContent'))
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_the_slider_goes_through_time_and_the_link_names_the_step(self):
        self.open_and_wait('#dataset=flow&surface=40&step=0')
        self.until('document.getElementById("step").max === "5"')
        before, slider = self.picture(), self.by_id('step')
        slider.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
        self.until_step(2)
        self.assertLess(self.share_of_equal(self.picture(), before), 0.99)
        self.assertEqual('0.5 s · step 2 (3 of 6)', slider.get_attribute('aria-valuetext'))
        self.until('location.hash.includes("step=2")')
        ActionChains(self.browser, duration=10).move_to_element_with_offset(
            slider, slider.rect['width'] // 2 - 3, 0).click().perform()
        self.until_step(5)
        self.assertTrue(self.by_id('step-on').get_attribute('disabled'))
        # A link by time reopens at the nearest step.
        self.open_and_wait('#dataset=flow&surface=40&time=0.6')
        self.until('document.getElementById("step").value === "2"')

    def test_keys_and_buttons_take_single_steps_and_stay_within_the_ends(self):
        self.open_and_wait('#dataset=flow&surface=40&step=4')
        self.until('document.getElementById("step").max === "5"')
        self.js('isoscope.view.root.focus()')
        ActionChains(self.browser).send_keys(']').perform()
        self.until_step(5)
        ActionChains(self.browser).send_keys(']').send_keys('[').perform()
        self.until_step(4)
        self.by_id('step-back').click()
        self.until_step(3)
        self.by_id('step-on').click()
        self.until_step(4)

    def test_play_shows_every_step_in_order_and_ends_at_the_last_one_exactly(self):
        self.open_and_wait('#dataset=flow&surface=40')
        self.until('document.getElementById("step").max === "5"')
        self.js(self.RECORD)
        self.by_id('play').click()
        self.until(f'steps.includes(0) && steps.includes(5) && {self.IS_RESTING}')
        self.assertEqual([0, 1, 2, 3, 4, 5], self.js('return steps'))
        self.until_step(5)

    def test_a_loop_plays_on_until_a_key_ends_it(self):
        self.open_and_wait('#dataset=flow&surface=40&step=4')
        self.until('document.getElementById("step").max === "5"')
        self.by_id('loop').click()
        self.js(self.RECORD)
        ActionChains(self.browser).send_keys(' ').perform()
        self.until('steps.length > 8')
        self.assertEqual([5, 0, 1, 2, 3, 4, 5, 0], self.js('return steps.slice(0, 8)'))
        ActionChains(self.browser).send_keys(' ').perform()
        self.until(f'isoscope.view.isExact && {self.IS_RESTING}')
        at = self.js(f'return {self.STEP}')
        time.sleep(0.5)
        self.until_step(at)

    def test_an_error_ends_the_play(self):
        self.open_and_wait('#dataset=flow&surface=40&step=0')
        self.until('document.getElementById("step").max === "5"')
        self.gateway.control(fail={'code': 14, 'message': 'agent 1 was lost'})
        self.by_id('play').click()
        self.until(f'isoscope.view.stats().notice.includes("was lost") && {self.IS_RESTING}')

    def test_the_menu_chooses_a_field_with_an_isovalue_of_its_own(self):
        self.open_and_wait('#dataset=flow&surface=70&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.gateway.control(reset=True)
        self.choose('field', 'velocity:x')
        self.until('isoscope.view.isExact && isoscope.view.state.selection.component === "x"')
        state = self.js('return isoscope.view.getState()')
        self.assertEqual(({'field': 'velocity', 'component': 'x', 'timeStep': 1}, 40),
                         (state['selection'], state['surfaces'][0]['isovalue']))
        asked = [target for target in self.gateway.control()['targets'] if '/histogram' in target]
        self.assertEqual(['/v1/datasets/flow/histogram?bins=256&field=velocity&component=x&step=1'], asked)
        self.until('document.getElementById("step").max === "4"')  # those of the field
        # The axis is the range over all steps.
        ticks = [tick.get_attribute('textContent') for tick in self.browser.find_elements(By.CSS_SELECTOR, '#chart .tick')]
        self.assertEqual(['-2', '24', '50'], ticks)

    def test_colours_by_a_field_have_a_legend_with_its_unit(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.choose('quantity', 'field:velocity:magnitude')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy')
        self.assertEqual({'quantity': 'QUANTITY_FIELD', 'field': 'velocity', 'component': 'magnitude', 'colorMap': 'COLOR_MAP_VIRIDIS'},
                         self.js('return isoscope.view.state.surfaces[0].colorBy'))
        self.assertIn('velocity magnitude (m/s)', self.by_id('legend').text)
        self.until('location.hash.includes("color-by=velocity:magnitude:viridis")')

    def test_steps_that_come_while_it_is_open_are_there_and_the_last_one_is_followed(self):
        # A server that refines draws no request twice.
        for features, refine in ((['notes'], None), (['notes', 'refinement'], {'tiles': 12, 'bytes': 1000, 'seconds': 0.1})):
            with self.subTest(features=features):
                self.gateway.control(features=features, refine=refine, steps=6)
                self.open_and_wait('#dataset=flow&surface=40')
                # The second time the request is the same: the first one had no camera yet.
                for steps, text in ((7, '1.5 s · step 6 (7 of 7)'), (8, '1.75 s · step 7 (8 of 8)')):
                    self.gateway.control(steps=steps, mute=True)
                    self.until(f'document.getElementById("step").max === "{steps - 1}" && !isoscope.view.loop.stream.isDirty')
                    self.assertFalse(self.js('return isoscope.view.isExact'), 'the picture of the step before counts as that of the last one')
                    self.gateway.control(mute=False)
                    self.until_exact()
                    self.assertEqual(text, self.by_id('time').text)
                    self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        # Links, commands, picks and downloads mean the step on the screen.
        self.by_id('save').click()
        self.assertIn('--step 7', self.by_id('command').text)


    def test_a_picked_point_has_the_values_of_all_fields_where_all_have_the_step(self):
        for step, has_values in ((3, True), (5, False)):  # velocity lacks the last step
            self.open_and_wait(f'#dataset=flow&surface=40&step={step}')
            self.js('isoscope.view.root.focus()')
            ActionChains(self.browser).send_keys(Keys.ENTER).perform()
            self.until('isoscope.view.loop.overlay.pins.length === 1')
            rows = self.js('return [...document.querySelectorAll("#points dt.field")].map((e) => [e.textContent, e.nextSibling.textContent])')
            self.assertEqual([['pressure', '40 Pa'], ['velocity x', '0 m/s'], ['velocity y', '0.5 m/s'], ['velocity z', '1 m/s'],
                              ['velocity magnitude', '1.5 m/s']] if has_values else [], rows)


class ScreenReaderTest(PageTest):
    # Collects what live regions say, in the page and in the view.
    LISTEN = '''window.said = [];
        window.regions = () => [document, ...[...document.querySelectorAll('.isoscope-view')].map((e) => e.shadowRoot)]
          .flatMap((root) => [...root.querySelectorAll('[aria-live], [role=status], [role=alert], [role=log], output')]);
        for (const region of regions()) new MutationObserver(() => said.push(region.textContent)).observe(region,
          { childList: true, subtree: true, characterData: true });'''

    def test_figures_of_a_moving_view_are_not_said(self):
        self.open_and_wait()
        self.js(self.LISTEN)
        self.assertEqual(['dialog-speech', 'speech'], sorted(self.js('return regions().map((e) => e.id)')))
        frames = self.js('return isoscope.view.stats().framesShown')
        for _ in range(3):
            self.drag(60, 20, steps=6, is_seen=True)
        self.until_exact()
        self.assertGreater(self.js('return isoscope.view.stats().framesShown'), frames + 3)
        handle = self.browser.find_element(By.CSS_SELECTOR, '#histogram .handle circle')
        ActionChains(self.browser, duration=10).move_to_element(handle).click_and_hold().move_by_offset(40, 0).release().perform()
        self.until_exact()
        self.assertEqual([], self.js('return said'))

    def test_every_slider_has_a_name_its_limits_and_its_value_in_words(self):
        self.open_and_wait('#dataset=patient&surface=30:1,0,0:0.4&surface=70&color-by=z:turbo&clip-plane=0.5,0.25,1,20')
        self.until('document.querySelector("#planes input").value !== "" && document.querySelector("#clip [aria-valuetext]")')
        sliders = self.js('''return [...document.querySelectorAll('[role=slider], input[type=range]')]
            .filter((e) => !e.closest('[hidden]')).map((e) => ({
            name: e.getAttribute('aria-label') ?? e.labels?.[0]?.textContent ?? '', text: e.getAttribute('aria-valuetext') ?? '',
            min: e.getAttribute('aria-valuemin') ?? e.getAttribute('min'), max: e.getAttribute('aria-valuemax') ?? e.getAttribute('max'),
            now: e.getAttribute('aria-valuenow') ?? e.value, step: e.getAttribute('step'), isInput: e.localName === 'input' }));''')
        self.assertEqual(2 + 2 + 2 + 6 + 1, len(sliders))
        self.assertEqual(len(sliders), len({slider['name'] for slider in sliders}), 'two sliders have one name')
        for slider in sliders:
            with self.subTest(slider['name']):
                self.assertTrue(slider['name'])
                self.assertLess(float(slider['min']), float(slider['max']))
                self.assertLessEqual(float(slider['min']), float(slider['now']))
                self.assertLessEqual(float(slider['now']), float(slider['max']))
                self.assertRegex(slider['text'], r'^-?[0-9]')
                if slider['isInput']:
                    self.assertGreater(float(slider['step']), 0)
        text = {slider['name']: slider['text'] for slider in sliders}
        self.assertEqual(('40 %', '30', '100 mm', '20 mm'), (text['Opacity of surface 1'], text['Isovalue 1'], text['Greatest L'],
                                                              text['Place of plane 1']))

    def test_keys_take_a_slider_by_steps_and_to_its_ends_and_it_keeps_the_focus(self):
        self.open_and_wait()
        for selector, value in (('#histogram .handle', 'isoscope.view.state.surfaces[0].isovalue'),
                                ('#clip [data-axis=x][data-end=high]', '(isoscope.view.state.clip?.box?.max.x ?? 100)')):
            self.js('window.slider = document.querySelector(arguments[0]); slider.focus();', selector)
            for key, condition in ((Keys.HOME, '<'), (Keys.PAGE_UP, '>'), (Keys.ARROW_RIGHT, '>'), (Keys.ARROW_LEFT, '<'), (Keys.END, '>')):
                before = self.js(f'return {value}')
                ActionChains(self.browser).send_keys(key).perform()
                self.until(f'{value} {condition} {before} && Number(slider.getAttribute("aria-valuenow")) === {value}')
                self.assertTrue(self.js('return document.activeElement === slider'))
            self.assertEqual(100, self.js(f'return {value}'))

    def test_enter_picks_the_point_at_the_cross_and_it_is_said(self):
        self.open_and_wait()
        self.js(self.LISTEN)
        self.assertEqual('none', self.js('return getComputedStyle(isoscope.view.loop.elements.cross).display'))
        self.js('isoscope.view.root.focus()')
        self.assertEqual('block', self.js('return getComputedStyle(isoscope.view.loop.elements.cross).display'))
        ActionChains(self.browser).send_keys(Keys.ENTER).perform()
        self.until('isoscope.view.loop.overlay.pins.length === 1 && said.length === 1')
        position = self.js('return isoscope.view.loop.overlay.pins[0].position')
        ray = self.js('const c = isoscope.view.camera; return [c.eye, c.target]')
        # On the ball, on the line from the eye to the target, up to half a pixel.
        self.assertAlmostEqual(28 * 1.2, math.dist(position, (50, 50, 50)), places=6)
        self.assertLess(math.dist(position[:2], ray[1][:2]), 1)
        words = '; '.join(f'{value:.5g}' for value in position)
        self.assertEqual([f'Point A: position {words}. Value 40.'], self.js('return said'))
        self.assertIn('Enter picks', self.js('return isoscope.view.root.getAttribute("aria-label")'))

    def test_a_pick_of_the_background_is_said(self):
        self.open_and_wait()
        self.js(self.LISTEN + 'isoscope.view.update({ surfaces: [{ isovalue: 100 }] });')
        self.until_exact()
        self.js('isoscope.view.root.focus()')
        ActionChains(self.browser).send_keys(Keys.ENTER).perform()
        self.until('said.length === 1')
        self.assertEqual(['There is no surface at this point.'], self.js('return said'))

    def test_a_lost_connection_is_said_once_and_so_is_its_return(self):
        self.open_and_wait()
        self.js(self.LISTEN)
        self.gateway.control(refuse=True, drop=[1011, 'the coordinator is away'])
        self.until('isoscope.view.loop.connection.attempt >= 3')
        self.gateway.control(refuse=False)
        self.until('isoscope.view.isExact && isoscope.view.stats().reconnects === 1 && said.length > 1')
        self.assertEqual(['The connection ended: the coordinator is away.', 'Connected again.'], self.js('return said'))

    def test_nothing_moves_by_itself_where_people_want_no_motion(self):
        spinning = 'isoscope.view.loop.elements.notice.getAnimations({ subtree: true }).length'
        try:
            for wish, count in (('no-preference', 1), ('reduce', 0)):
                self.browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': [{'name': 'prefers-reduced-motion', 'value': wish}]})
                self.gateway.control(mute=True)
                self.open('#dataset=ball&surface=40')
                self.until('/Drawing the picture/.test(isoscope.view.stats().notice)')
                self.assertEqual(count, self.js(f'return {spinning}'))
                self.assertEqual(count, self.js(f'return document.getAnimations().length + {spinning}'))
        finally:
            self.browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})


class HiddenTabTest(PageTest):
    # Hides the tab as the page sees it. Waits of the page are short, so that what it would ask for comes soon.
    SCRIPT = '''for (const name of ['setTimeout', 'setInterval']) {
          const later = window[name].bind(window);
          window[name] = (action, ms, ...rest) => later(action, Math.min(ms ?? 0, 60), ...rest);
        }
        window.underWay = 0;
        const get = window.fetch.bind(window);
        window.fetch = (...words) => {
          underWay += 1;
          return get(...words).finally(() => { underWay -= 1; });
        };
        window.hideTab = (isHidden) => {
          Object.defineProperty(document, 'hidden', { configurable: true, get: () => isHidden });
          document.dispatchEvent(new Event('visibilitychange'));
        };'''

    def setUp(self):
        super().setUp()
        self.script = self.browser.execute_cdp_cmd('Page.addScriptToEvaluateOnNewDocument', {'source': self.SCRIPT})

    def tearDown(self):
        self.browser.execute_cdp_cmd('Page.removeScriptToEvaluateOnNewDocument', self.script)

    def hide(self):
        self.js('hideTab(true)')
        self.until('underWay === 0')  # the browser asks for one address once at a time
        self.until_still(lambda: [self.gateway.control()[name] for name in ('targets', 'states')])
        self.gateway.control(reset=True)

    def check_silence(self):
        time.sleep(0.7)
        seen = self.gateway.control()
        self.assertEqual(([], 0), (seen['targets'], seen['states']), 'a hidden tab asked for something')

    def until_asked(self, target):
        end = time.monotonic() + PATIENCE_S
        while target not in self.gateway.control()['targets']:
            self.assertLess(time.monotonic(), end, f'{target} was never asked for')
            time.sleep(0.02)

    def test_a_hidden_tab_asks_for_no_status_and_sends_no_view_until_it_is_shown(self):
        self.open_and_wait()
        self.until_asked('/v1/status')
        self.hide()
        self.js('isoscope.view.update({ maxLayers: 3 }); isoscope.view.setCamera({ ...isoscope.view.camera, fovYDegrees: 20 });')
        self.check_silence()
        self.js('hideTab(false)')
        self.until_asked('/v1/status')
        self.until('isoscope.view.isExact && isoscope.view.loop.picture.frame.camera.fovYDegrees === 20')
        self.assertEqual(3, self.gateway.control()['last']['frame']['maxLayers'])

    def test_a_connection_that_ends_behind_a_hidden_tab_comes_back_when_it_is_shown(self):
        self.open_and_wait()
        self.hide()
        self.gateway.control(drop=[1011, 'the coordinator is away'])
        self.until('!isoscope.view.loop.connection.isOpen')
        self.check_silence()
        self.js('hideTab(false)')
        self.until('isoscope.view.isExact && isoscope.view.stats().reconnects === 1')

    def test_a_frame_that_failed_is_not_asked_for_again_by_a_hidden_tab(self):
        self.open_and_wait()
        self.gateway.control(fail={'code': 14, 'message': 'an agent was lost'})
        self.drag(30, 0)
        self.until('/was lost/.test(isoscope.view.stats().notice)')
        self.hide()
        self.check_silence()
        self.gateway.control(fail=None)
        self.js('hideTab(false)')
        self.until('isoscope.view.isExact && isoscope.view.stats().notice === ""')

    def test_a_page_that_opens_behind_another_tab_begins_when_it_is_shown(self):
        hidden = self.browser.execute_cdp_cmd('Page.addScriptToEvaluateOnNewDocument',
                                              {'source': 'hideTab(true);'})
        try:
            self.open()
            self.until('isoscope.view')
            self.check_silence()
            self.js('hideTab(false)')
            self.until('isoscope.view.isExact')
        finally:
            self.browser.execute_cdp_cmd('Page.removeScriptToEvaluateOnNewDocument', hidden)


class LatencyTest(PageTest):
    # The page's clock stands still but for this test; the server answers when it is told to.
    # A view that moves goes on doing so: at rest the page tells no latency of a frame before the last.
    CLOCK = '''let clock = performance.now();
        performance.now = () => clock;
        const later = window.setTimeout;
        window.setTimeout = (action, ms, ...rest) => ms === 500 ? 0 : later(action, ms, ...rest);
        window.pass = (ms) => { clock += ms; };
        window.turn = () => {
          const { camera } = isoscope.view;
          isoscope.view.setCamera({ ...camera, fovYDegrees: camera.fovYDegrees - 1 });
          return isoscope.view.loop.stream.sequence;
        };'''

    def check_shown(self, sequence, text):
        self.gateway.control(answer=sequence)
        self.until(f'isoscope.view.loop.frames.shownSequence === {sequence}')
        self.until(f'/· {text} ms/.test(document.getElementById("state").textContent)')

    def test_the_latency_is_that_of_the_frame_on_the_screen_and_of_no_other_one(self):
        self.open_and_wait()
        self.gateway.control(mute=True)
        self.js(self.CLOCK)
        first, second = self.js('pass(1000); const first = turn(); pass(4000); const second = turn(); pass(1000); return [first, second];')
        self.assertEqual(first + 1, second)
        # The second state is under way when the frame of the first one is shown.
        self.check_shown(first, '5,000')
        self.js('pass(500)')
        self.check_shown(second, '1,500')
        self.assertEqual(1500, self.js('return isoscope.view.stats().shownLatencyMs'))

    def test_a_slider_has_its_own_latency_and_not_that_of_the_drag_before(self):
        self.open_and_wait()
        self.gateway.control(mute=True)
        self.js(self.CLOCK)
        first = self.js('pass(1000); const first = turn(); pass(4000); return first;')
        self.check_shown(first, '4,000')
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 60 }] }, { isMoving: true });')
        self.until(f'isoscope.view.loop.stream.sequence === {first + 1}')
        self.js('pass(700)')
        self.check_shown(first + 1, '700')


class LinkTest(PageTest):
    def test_a_link_reopens_the_same_view_to_the_pixel(self):
        self.open_and_wait('#dataset=ball&surface=30:0.2,0.6,0.9&surface=70:1,0.5,0&clip-plane=-1,0.25,0,-60')
        self.drag(100, -60)
        self.until_exact()
        self.browser.find_element(By.ID, 'link').click()
        url, state, picture = self.browser.current_url, self.js('return isoscope.view.getState()'), self.picture()
        self.browser.get('about:blank')
        self.browser.get(url)
        self.until_open()
        self.assertEqual(state, self.js('return isoscope.view.getState()'))
        self.assertEqual(1, self.share_of_equal(self.picture(), picture))

    def test_a_link_pasted_into_the_open_page_is_followed(self):
        self.open_and_wait()
        self.js('location.hash = "#dataset=patient&surface=65"')
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "patient"')
        self.assertEqual(65, self.js('return isoscope.view.state.surfaces[0].isovalue'))

    def test_a_broken_link_says_what_is_left_out_and_shows_the_rest(self):
        self.open_and_wait('#dataset=ball&surface=55&clip-box=1,2,x&nonsense=1')
        self.until('document.getElementById("toast").textContent')
        toast = self.js('return document.getElementById("toast").textContent')
        self.assertIn('clip-box=1,2,x', toast)
        self.assertIn('nonsense', toast)
        self.assertEqual(55, self.js('return isoscope.view.state.surfaces[0].isovalue'))


class ColorTest(PageTest):
    def test_names_of_colours_mean_what_the_browser_means(self):
        self.open_and_wait()
        wrong = self.js('''const context = document.createElement('canvas').getContext('2d');
            return import('./css-colors.js').then(({ CSS_COLORS, colorFromText }) => {
              const theirs = (text) => { context.fillStyle = '#010203'; context.fillStyle = text; return context.fillStyle; };
              const digits = (color) => '#' + [color.red, color.green, color.blue].map((c) => Math.round(255 * c).toString(16).padStart(2, '0')).join('');
              const names = [...CSS_COLORS.keys()].filter((name) => name !== 'transparent');
              return names.length === 148 ? names.filter((name) => digits(colorFromText(name)) !== theirs(name)) : names.length; });''')
        self.assertEqual([], wrong)

    def test_a_link_may_name_colours(self):
        self.open_and_wait('#dataset=ball&surface=40:tomato&background=#fff')
        self.until('document.querySelector("#surfaces input[type=color]")')
        self.assertEqual(('#ff6347', '#ffffff'), tuple(self.js('return [document.querySelector("#surfaces input[type=color]").value, '
                                                               'document.getElementById("background").value]')))
        self.assertEqual((255, 255, 255), self.picture()[2][0][0])
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))


class TokenTest(PageTest):
    # With the characters of base64 that neither an address nor a protocol's name takes as they are.
    TOKEN = 'a+b/c=~.-_9'
    QUERY = '?token=a%2Bb%2Fc%3D~.-_9&theme=dark&max-side=420'

    def setUp(self):
        super().setUp()
        self.gateway.control(token=self.TOKEN)

    def test_the_token_goes_as_a_header_and_stays_in_no_address(self):
        self.open_and_wait()
        self.assertNotIn('token', self.browser.current_url)
        self.assertIn('theme=dark', self.browser.current_url)
        self.js('document.getElementById("save").click(); document.getElementById("save-png").click();')
        self.until('/B$/.test(document.getElementById("save-note").textContent)')
        targets = self.gateway.control()['targets']
        self.assertGreater(len(targets), 4)
        for word in ('token', self.TOKEN, 'a%2Bb'):
            self.assertEqual([], [one for one in targets if word in one], 'an address has the token')

    def test_a_link_has_no_token(self):
        self.open_and_wait()
        self.js('navigator.clipboard.writeText = async (text) => { window.copied = text; };')
        self.browser.find_element(By.ID, 'link').click()
        self.until('window.copied')
        copied = self.js('return window.copied')
        self.assertIn('#dataset=ball', copied)
        self.assertNotIn('token', copied)
        self.assertNotIn('a%2Bb', copied)

    def test_a_reload_needs_no_second_look_at_what_was_printed(self):
        self.open_and_wait()
        self.browser.refresh()
        self.until_open()
        self.assertNotIn('token', self.browser.current_url)

    def test_a_token_of_another_page_is_not_sent(self):
        self.open_and_wait()
        # As a notebook's: the page has a token in its address that is its own affair.
        self.gateway.control(token=None)
        self.open_and_wait('', '?theme=dark')
        self.gateway.control(reset=True)
        shown = self.js('''const url = new URL(location.href); url.searchParams.set('token', 'of-the-notebook');
            history.replaceState(null, '', url);
            return import('./isoscope-view.js').then(async (m) => {
              const client = new m.Client(location.origin + '/');
              await client.get('v1/datasets');
              return [client.token, client.socketAddress]; });''')
        self.assertEqual('', shown[0])
        self.assertNotIn('of-the-notebook', shown[1] + ''.join(self.gateway.control()['targets']))


class TextTest(PageTest):
    """Text of servers is text."""
    HOSTILE = '<img src=x onerror="window.hit=1"><script>window.hit=1</script><b id=hit>'

    def check_harmless(self):
        self.assertIsNone(self.js('return window.hit ?? document.getElementById("hit")'))

    def test_a_name_is_shown_as_it_is(self):
        self.gateway.control(name=self.HOSTILE)
        self.open_and_wait()
        self.assertEqual(self.HOSTILE, self.js('return document.getElementById("dataset").selectedOptions[0].textContent'))
        self.assertIn(self.HOSTILE, self.browser.title)
        self.check_harmless()

    def test_an_error_is_shown_as_it_is(self):
        self.gateway.control(fail={'code': 5, 'message': self.HOSTILE})
        self.open()
        self.until('/onerror/.test(isoscope.view.stats().notice)')
        self.assertIn(self.HOSTILE, self.notice())
        self.check_harmless()


class FailureTest(PageTest):
    def test_a_failed_frame_is_a_sentence_and_the_next_good_one_removes_it(self):
        self.open_and_wait()
        self.gateway.control(fail={'code': 14, 'message': 'agent 10.0.0.7:50061 was lost; it has shards 0, 3'})
        self.drag(30, 0)
        self.until('/was lost/.test(isoscope.view.stats().notice)')
        self.assertIn('Agent 10.0.0.7:50061 was lost; it has shards 0, 3. (UNAVAILABLE) Trying again.', self.notice())
        self.gateway.control(fail=None)
        # By itself: without input.
        self.until('isoscope.view.isExact && isoscope.view.stats().notice === ""')

    def test_why_a_surface_does_not_show_is_said_until_it_shows(self):
        self.gateway.control(note='isovalue 400 has no surface: the samples are 0 to 100')
        self.open_and_wait()
        self.until('document.getElementById("notes").innerText === "isovalue 400 has no surface: the samples are 0 to 100"')
        self.gateway.control(note=None)
        self.drag(30, 0)
        self.until('document.getElementById("notes").hidden')

    def test_an_older_gateway_is_asked_for_no_notes_and_shows_pictures(self):
        self.gateway.control(features=None, note='not asked for')
        self.open_and_wait()
        self.assertNotIn('withNotes', self.gateway.control()['last']['frame'])
        self.assertTrue(self.js('return document.getElementById("notes").hidden'))
        self.assertEqual('', self.notice())

    def test_a_lost_connection_is_said_and_comes_back_by_itself_with_the_state(self):
        self.open_and_wait()
        self.drag(60, 20)
        self.until_exact()
        picture = self.picture()
        # The next attempt, half a second later, has a sentence of its own.
        self.js("window.told = []; isoscope.view.addEventListener('notice', ({ detail: { sentence } }) => told.push(sentence));")
        self.gateway.control(refuse=True, drop=[1011, 'the coordinator at 127.0.0.1:50051 does not answer'])
        self.until('told.some((one) => /coordinator at 127.0.0.1:50051 does not answer. Trying again in/.test(one))')
        self.assertEqual('not connected', self.browser.find_element(By.ID, 'state').text)
        self.gateway.control(refuse=False)
        self.until('isoscope.view.isExact && isoscope.view.stats().reconnects === 1')
        self.assertEqual('', self.notice())
        self.assertEqual(1, self.share_of_equal(self.picture(), picture))

    def test_a_page_whose_stream_is_refused_says_what_to_do_and_connects_later(self):
        self.gateway.control(refuse=True)
        self.open()
        self.until('/Is isoscope-gateway .* running there, and does a proxy/.test(isoscope.view.stats().notice)')
        self.gateway.control(refuse=False)
        self.until('isoscope.view.isExact')

    def test_a_server_that_does_not_answer_is_said(self):
        self.gateway.control(mute=True)
        self.open('#dataset=ball&surface=40')
        self.until('/Drawing the picture/.test(isoscope.view.stats().notice)')
        self.gateway.control(mute=False)
        self.until('isoscope.view.isExact && isoscope.view.stats().notice === ""')

    def test_bytes_that_are_no_frame_are_said_and_do_no_harm(self):
        self.open_and_wait()
        picture = self.picture()
        header = json.dumps({'sequenceNumber': '99', 'frameNumber': '9', 'image': {'type': 'image/png', 'bytes': 4},
                             'frame': {'camera': {}}}).encode()
        for raw in (b'', b'\xff\xff\xff\xff', struct.pack('<I', len(header)) + header + b'junk'):
            self.gateway.control(raw=base64.b64encode(raw).decode() or 'AA==')
            self.js('isoscope.view.update({maxLayers: 3})')
            self.until('/no frame|cannot decode/.test(isoscope.view.stats().notice)')
            self.assertEqual(1, self.share_of_equal(self.picture(), picture))
        self.gateway.control(raw=None)
        self.js('isoscope.view.update({maxLayers: 4})')
        self.until('isoscope.view.isExact && isoscope.view.stats().notice === ""')

    def test_a_server_that_is_gone_is_said_where_one_looks(self):
        other = Gateway()
        try:
            self.browser.get(other.url + self.QUERY)
            self.until_open()
        finally:
            other.stop()
        self.until('/was lost. Trying again in/.test(isoscope.view.stats().notice)')
        self.js('document.getElementById("save").click(); document.getElementById("save-png").click();')
        self.until('/does not answer/.test(document.getElementById("save-note").textContent)')


class RealPageTest(PageTest):
    """The page of a real `isoscope view`, which ISOSCOPE_BIN has."""
    FLAGS = ['--isovalue', '100']

    @classmethod
    def make_volume(cls):
        """Returns the path of what is shown."""
        volume = os.path.join(cls.folder, 'gyroid.nrrd')
        cls.make('generate', 'gyroid', '--dims', '48,48,48', '--type', 'uint8', '--output', volume)
        return volume

    @classmethod
    def make(cls, *words):
        subprocess.run([cls.program, *words], check=True, stdout=subprocess.DEVNULL, env=cls.environment)

    @classmethod
    def setUpClass(cls):
        program = os.path.join(os.environ.get('ISOSCOPE_BIN', ''), 'isoscope')
        if not os.path.exists(program):
            skips.skip('programs', 'ISOSCOPE_BIN names no folder with isoscope')
        super().setUpClass()
        cls.program = program
        cls.folder = tempfile.mkdtemp(prefix='isoscope-page-')
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.environment = {**os.environ, 'XDG_CACHE_HOME': cls.folder}
        cls.volume = cls.make_volume()
        cls.server = subprocess.Popen([program, 'view', cls.volume, *cls.FLAGS, '--no-open', '--listen', '127.0.0.1:0', '--renderer', 'cpu'],
                                      stdout=subprocess.PIPE, text=True, env=cls.environment)
        cls.addClassCleanup(cls.stop_server)
        cls.page = cls.server.stdout.readline().strip()

    @classmethod
    def stop_server(cls):
        cls.server.terminate()
        cls.server.wait()
        cls.server.stdout.close()

    def show(self, address):
        self.browser.get('about:blank')
        self.browser.get(address)
        self.until_open()

    def command_line(self):
        """The picture of the command that the page shows, on the same volume."""
        self.js('''document.getElementById("save").click();
            const samples = document.getElementById('save-samples'); samples.value = String(isoscope.view.state.samples ?? 1);
            samples.dispatchEvent(new Event('input'));''')
        command = self.js('return document.getElementById("command").textContent')
        self.js('document.getElementById("dialog").close()')
        words = shlex.split(command.replace('\\\n', ' '))
        # As people run it: in the folder of the file.
        self.assertEqual(['isoscope', 'render', os.path.basename(self.volume)], words[:3])
        subprocess.run([self.program, *words[1:], '--renderer', 'cpu'], check=True, cwd=self.folder,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=self.environment)
        with open(os.path.join(self.folder, 'picture.png'), 'rb') as file:
            return decode_png(file.read())


class RealTest(RealPageTest):
    def test_the_address_of_isoscope_view_opens_what_was_asked_for(self):
        self.show(f'{self.page}&max-side=420')
        self.until('location.hash')
        self.assertIn('isovalue=100', self.page)
        self.assertEqual(100, self.js('return isoscope.view.state.surfaces[0].isovalue'))
        # A later change is in the link, and takes precedence.
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 90 }] })')
        self.until('isoscope.view.isExact && /surface=90/.test(location.hash)')
        self.browser.refresh()
        self.until_open()
        self.assertEqual(90, self.js('return isoscope.view.state.surfaces[0].isovalue'))

    def test_the_labels_of_isoscope_view_are_those_of_the_command_line(self):
        ball = os.path.join(self.folder, 'ball.nrrd')
        subprocess.run([self.program, 'generate', 'labels', '--dims', '40,40,40', '--regions', '7', '--output', ball], check=True,
                       stdout=subprocess.DEVNULL, env=self.environment)
        every = [[1], [2], [3], [4], [5], [6], [7]]
        several = ['--isovalue', '6.5', '--label', 'core', '--label', '2-4,cell 6:teal:0.5', '--label', '5::0.25']
        for flags, drawn, labels in (([], ['--labels', 'all'], every),
                                     (['--labels', 'all'], ['--labels', 'all'], every),
                                     (['--labels', 'all', '--smooth-labels'], ['--labels', 'all', '--smooth-labels'], every),
                                     (several, several, [6.5, [1], [2, 3, 4, 6], [5]])):
            server = subprocess.Popen([self.program, 'view', ball, *flags, '--no-open', '--listen', '127.0.0.1:0', '--renderer', 'cpu'],
                                      stdout=subprocess.PIPE, text=True, env=self.environment)
            try:
                page = server.stdout.readline().strip()
                self.show(f'{page}&max-side=420&theme=dark')
                self.assertEqual(labels, self.js('return isoscope.view.state.surfaces.map((one) => one.labels ?? one.isovalue)'))
                self.assertEqual(len([one for one in labels if one != 6.5 and len(one) == 1]),
                                 len(self.browser.find_elements(By.CSS_SELECTOR, '#label-list :checked')))
                shown = self.picture()
                subprocess.run([self.program, 'render', ball, '--renderer', 'cpu', *drawn, '--width', str(shown[0]), '--height', str(shown[1]),
                                '--background', '#0b0e14', '--output', 'labels.png'], check=True, cwd=self.folder,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=self.environment)
                with open(os.path.join(self.folder, 'labels.png'), 'rb') as file:
                    self.assertGreater(self.share_of_equal(shown, decode_png(file.read()), tolerance=1), 0.9999)
            finally:
                server.terminate()
                server.wait()
                server.stdout.close()

    def test_without_a_link_it_begins_as_the_command_line_does(self):
        run = {'check': True, 'cwd': self.folder, 'env': self.environment, 'stderr': subprocess.DEVNULL}
        histogram = json.loads(subprocess.run([self.program, 'info', self.volume, '--histogram', '--json'], stdout=subprocess.PIPE, **run).stdout)
        isovalue = next(one['isovalue'] for one in histogram['histogram']['suggestions'] if one['method'] == 'between_classes')
        subprocess.run([self.program, 'render', self.volume, '--renderer', 'cpu', '--isovalue', str(isovalue), '--output', 'front.png',
                        '--save-camera', 'front.json'], stdout=subprocess.DEVNULL, **run)
        with open(os.path.join(self.folder, 'front.json'), encoding='utf-8') as file:
            camera = json.load(file)
        address = urllib.parse.urlsplit(self.page)
        token = urllib.parse.parse_qs(address.query).get('token', [''])[0]
        self.show(f'{address.scheme}://{address.netloc}/?max-side=420&token={urllib.parse.quote(token)}')
        state = self.js('return isoscope.view.getState()')
        # The same but for digits that nobody reads, of a range of 255.
        self.assertEqual(1, len(state['surfaces']))
        self.assertAlmostEqual(isovalue, state['surfaces'][0]['isovalue'], delta=0.06)
        self.assertEqual(state['surfaces'][0]['isovalue'], round(state['surfaces'][0]['isovalue'], 1))
        for name in ('eye', 'target', 'up'):
            self.assertEqual(camera[name], list(state['camera'][name].values()), name)
        self.assertEqual(camera['perspective']['fov_y_degrees'], state['camera']['perspective']['fovYDegrees'])

    def test_another_site_shows_no_picture_of_it_and_its_link_to_the_page_is_followed(self):
        address = urllib.parse.urlsplit(self.page)
        query = urllib.parse.parse_qs(address.query)
        token = query.get('token', [''])[0]
        picture = f'{address.scheme}://{address.netloc}/v1/datasets/{query["dataset"][0]}/render?' + \
            urllib.parse.urlencode({'isovalue': 100, 'width': 32, 'height': 32, 'token': token})
        page = f'<title>other</title><img id="picture" src="{html.escape(picture)}"><a href="{html.escape(self.page)}">link</a>'

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header('Content-Type', 'text/html')
                self.end_headers()
                self.wfile.write(page.encode())

            def log_message(self, *_):
                pass

        with http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler) as server:
            threading.Thread(target=server.serve_forever).start()
            try:
                # Another site, and another port of the same one.
                for host in ('localhost', '127.0.0.1'):
                    self.browser.get(f'http://{host}:{server.server_port}/')
                    size = self.browser.execute_async_script('''const [done] = arguments;
                        const image = document.getElementById('picture');
                        const tell = () => done(image.naturalWidth);
                        if (image.complete) tell(); else image.onload = image.onerror = tell;''')
                    self.assertEqual(0, size, f'a page of {host} shows the picture')
                self.browser.find_element(By.TAG_NAME, 'a').click()
                self.until('isoscope.view.isExact')
                self.assertNotIn('token', self.browser.current_url)
            finally:
                server.shutdown()

    # Each control of the page, and a condition that holds once it has worked.
    CONTROLS = [
        ("document.getElementById('add').click()", 'isoscope.view.state.surfaces.length === 2'),
        *((f"choose('quantity', '{name}')", 'isoscope.view.state.surfaces[0].colorBy') for name in ('x', 'normal', 'gradient', 'z')),
        ("choose('map', 'cool-warm')", 'isoscope.view.state.surfaces[0].colorBy.colorMap === "COLOR_MAP_COOL_WARM"'),
        ("document.getElementById('range-min').value = '-1'; choose('range-max', '30')", 'isoscope.view.state.surfaces[0].colorBy.range'),
        ("document.getElementById('range-visible').click()", '(isoscope.view.state.surfaces[0].colorBy.range?.min ?? -1) !== -1'),
        ("choose('opacity-min', '0.5', 'input')", 'isoscope.view.state.surfaces[0].colorBy.opacity'),
        ("choose('quantity', 'none')", '!isoscope.view.state.surfaces[0].colorBy'),
        ("choose('background', '#336699', 'input')", 'isoscope.view.state.backgroundColor.red === 0.2'),
        *((f"choose('lights', '{name}')", 'isoscope.view.state.lights') for name in ('studio', 'side')),
        ("document.getElementById('ambient-occlusion').click()", 'isoscope.view.state.ambientOcclusion'),
        ("document.getElementById('silhouette').click()", 'isoscope.view.state.silhouette'),
        *((f"choose('samples', '{n}')", f'isoscope.view.state.samples === {n}') for n in (4, 9, 16)),
        ("choose('samples', '1')", '!isoscope.view.state.samples'),
        ("document.getElementById('parallel').click()", 'isoscope.view.camera.height > 0'),
        ("document.getElementById('add-plane').click()", 'isoscope.view.state.clip.halfSpaces'),
        ("press('#clip [data-axis=y][data-end=low]', 'PageUp')", 'isoscope.view.state.clip.box'),
        *((f"choose('caps', '{name}')", 'isoscope.view.state.caps') for name in ('filled', 'slice')),
        ("document.getElementById('window-all').click()", '!isoscope.view.state.caps.range'),
        ("document.getElementById('window-percentiles').click()", 'isoscope.view.state.caps.range.percentiles'),
        ("document.getElementById('window-low').value = '20'; choose('window-high', '90')", 'isoscope.view.state.caps.range.max === 90'),
        ("press('#histogram .handle', 'PageUp')", 'true'),
        ("document.querySelector('#views button:nth-child(2)').click()", '!isoscope.view.state.cameraFit'),
    ]

    def test_each_control_leaves_a_command_that_draws_the_picture_on_the_page(self):
        self.show(f'{self.page}&max-side=128')
        self.js('''window.choose = (id, value, type = 'change') => {
              const element = document.getElementById(id); element.value = value; element.dispatchEvent(new Event(type)); };
            window.press = (selector, key) => document.querySelector(selector).dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));''')
        for action, condition in self.CONTROLS:
            with self.subTest(action):
                self.js(action)
                self.command_line()  # also of a view that still moves
                self.until(f'isoscope.view.isExact && {condition}')
                self.assertEqual(1, self.share_of_equal(self.picture(), self.command_line()))

    def test_drag_slider_and_clip_rest_in_the_picture_of_the_command_line(self):
        self.show(f'{self.page}&max-side=420')
        self.drag(110, 50, steps=10)
        self.until_exact()
        self.assertEqual(1, self.share_of_equal(self.picture(), self.command_line()))
        handle = self.browser.find_element(By.CSS_SELECTOR, '#histogram .handle circle')
        value = self.js('return isoscope.view.state.surfaces[0].isovalue')
        ActionChains(self.browser, duration=10).move_to_element(handle).click_and_hold().move_by_offset(15, 0) \
            .move_by_offset(10, 0).release().perform()
        self.until(f'isoscope.view.isExact && isoscope.view.state.surfaces[0].isovalue > {value}')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.command_line()))
        self.js('isoscope.view.update({ clip: { halfSpaces: [{ normal: { x: 1 }, offset: 20 }] } })')
        self.until('isoscope.view.isExact && isoscope.view.state.clip')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.command_line()))


class RealRefiningTest(RealPageTest):
    """Pictures of a dataset with levels, by one thread: they take long enough for tiles."""
    FLAGS = ['--isovalue', '32768', '--threads', '1']
    GLASS = {'red': 0.9, 'green': 0.5, 'blue': 0.2, 'alpha': 0.5}
    # Keeps what is on the screen with each tile, and what came in which order.
    RECORD = '''const { view } = isoscope; const { picture, frames } = view.loop; window.seen = []; window.copies = []; let tiles = [];
        if (!window.paint) {
          window.paint = picture.paint.bind(picture);
          picture.paint = (bitmap, at, frame) => { tiles.push([at.x, at.y, bitmap.width, bitmap.height]); paint(bitmap, at, frame); };
          view.addEventListener('frame', ({ detail: { header, isExact, width } }) => {
            tiles = [];
            seen.push({ what: isExact ? 'exact' : 'frame', width, level: header.frame.drawnLevel.level ?? 0, isCurrent: view.isCurrent }); });
          view.addEventListener('refined', () => {
            if (!view.progress) return;
            const out = document.createElement('canvas'); out.width = picture.width; out.height = picture.height;
            picture.screen.draw(view.camera);
            const context = out.getContext('2d', { willReadFrequently: true }); context.drawImage(picture.screen.canvas, 0, 0);
            copies.push({ tiles: [...tiles], data: context.getImageData(0, 0, out.width, out.height).data });
            seen.push({ what: 'tiles', ...view.progress }); });
        }'''
    # The server waits for an acknowledgement where four parts have none: those of the last tiles come when all are shown.
    # A busy browser would leave out tiles that wait when the exact frame comes.
    PACE = '''const { connection, refinement, stream } = isoscope.view.loop; const acknowledge = connection.acknowledge.bind(connection); let held = [];
        connection.acknowledge = (message) => {
          if (!message.header.tile) { acknowledge(message); return; }
          held.push(message);
          if (held.length > 3) acknowledge(held.shift()); };
        isoscope.view.addEventListener('refined', () => {
          const progress = refinement.progressOf(stream.picture);
          if (progress?.done === progress?.count) { held.forEach(acknowledge); held = []; } });'''
    # Of each copy the greatest share of pixels of a tile that are not the server's, and the share of those that are elsewhere.
    COMPARE = '''const [png, done] = arguments;
        const blob = new Blob([Uint8Array.from(atob(png), (c) => c.charCodeAt(0))], { type: 'image/png' });
        createImageBitmap(blob, { premultiplyAlpha: 'none', colorSpaceConversion: 'none' })
          .then((bitmap) => {
            const { width, height } = bitmap; const out = document.createElement('canvas'); out.width = width; out.height = height;
            const context = out.getContext('2d'); context.drawImage(bitmap, 0, 0);
            const exact = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
            done(copies.map(({ tiles, data }) => {
              const pixels = new Uint32Array(data.buffer); const isTile = new Uint8Array(width * height); let wrong = 0;
              for (const [x, y, across, down] of tiles) {
                for (let j = y; j < y + down; ++j) for (let i = x; i < x + across; ++i) {
                  isTile[j * width + i] = 1; wrong += pixels[j * width + i] === exact[j * width + i] ? 0 : 1; } }
              let others = 0; let equal = 0;
              isTile.forEach((one, i) => { if (!one) { ++others; equal += pixels[i] === exact[i] ? 1 : 0; } });
              return { tiles: tiles.length, wrong, others, equal }; }));
          });'''

    @classmethod
    def make_volume(cls):
        volume, dataset = (os.path.join(cls.folder, name) for name in ('random.nrrd', 'random'))
        cls.make('generate', 'random', '--dims', '128,128,128', '--output', volume)
        cls.make('partition', volume, '--levels', '2', '--output', dataset)
        os.remove(volume)
        return dataset

    def exact_png(self):
        """The server's own picture of the state that the view is in."""
        state = self.asked_over_http()
        address = urllib.parse.urlsplit(self.page)
        token = urllib.parse.parse_qs(address.query).get('token', [''])[0]
        headers = {'Content-Type': 'application/json', **({'Authorization': f'Bearer {token}'} if token else {})}
        request = urllib.request.Request(f'{address.scheme}://{address.netloc}/v1/datasets/{state["dataset"]}/render',
                                         data=json.dumps(state).encode(), headers=headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
            return reply.read()

    def show_dark(self, query=''):
        self.show(f'{self.page}&theme=dark{query}')
        self.until('isoscope.view.isExact && isoscope.view.dataset.levels && location.hash')

    def look(self, isovalue, condition):
        """Shows a surface of glass, smoothly: the picture is a costly one."""
        self.js(self.RECORD)
        self.js('isoscope.view.update({ samples: 16, surfaces: [{ isovalue: arguments[0], color: arguments[1] }] })', isovalue, self.GLASS)
        self.until(condition)

    def assert_exact(self):
        self.assertEqual(1, self.share_of_equal(self.picture(), decode_png(self.exact_png())))

    def test_a_costly_picture_is_coarse_then_of_tiles_without_a_seam_then_exact(self):
        # Small pictures, and surfaces that the server has drawn before, may come too quickly for tiles.
        for renderer, first, costly in (('bitmaprenderer', 30000, 34000), ('webgl2', 26000, 37000)):
            with self.subTest(renderer), size_of(self.browser, 1150, 850):
                self.show_dark(f'&renderer={renderer}')
                self.js(self.PACE)
                self.look(first, 'isoscope.view.isExact && isoscope.view.state.samples')  # the server learns what one costs
                self.look(costly, 'isoscope.view.isExact && seen.at(-1)?.what === "exact"')
                self.assertEqual(renderer, self.js('return isoscope.view.stats().renderer'))
                seen = self.js('return seen')
                current = [one for one in seen if one['what'] != 'frame' or one['isCurrent']]
                width = current[-1]['width']
                tiles = [one for one in current if one['what'] == 'tiles']
                self.assertTrue(tiles, seen)
                coarse = current[current.index(tiles[0]) - 1]
                self.assertEqual(('frame', width), (coarse['what'], coarse['width']), seen)
                self.assertGreater(coarse['level'], 0)
                self.assertEqual(['tiles'] * len(tiles) + ['exact'], [one['what'] for one in current][-len(tiles) - 1:], seen)
                # On a busy machine the exact picture may be decoded before the last tiles are, which then show no more.
                shows_all_tiles = tiles[-1]['count'] == tiles[-1]['done']
                self.assertGreaterEqual(tiles[-1]['done'], tiles[-1]['count'] // 2)
                self.assertEqual(0, current[-1]['level'])
                compared = self.browser.execute_async_script(self.COMPARE, base64.b64encode(self.exact_png()).decode())
                self.assertEqual([one['done'] for one in tiles], [one['tiles'] for one in compared])
                self.assertEqual([0] * len(compared), [one['wrong'] for one in compared], 'pixels of tiles that are not the exact ones')
                self.assertEqual(shows_all_tiles, compared[-1]['others'] == 0, 'pixels that no tile had')
                self.assertTrue(all(one['equal'] < one['others'] for one in compared if one['others'] > 0))
                self.assert_exact()
                stats = self.js('return isoscope.view.stats()')
                self.assertEqual((0, ''), (stats['bitmapsOpen'], stats['notice']))

    def test_a_move_ends_the_tiles_of_the_view_before(self):
        # Large enough for six tiles of the largest side: fewer would all come before the move.
        with size_of(self.browser, 1500, 1000):
            self.show_dark()
            self.look(30000, 'isoscope.view.isExact && isoscope.view.state.samples')
            # The tiles that are not acknowledged hold back all but three that follow.
            self.js('''const { connection, picture } = isoscope.view.loop; const acknowledge = connection.acknowledge.bind(connection); window.held = [];
                connection.acknowledge = (message) => message.header.tile && !window.isFree ? held.push(message) : acknowledge(message);
                window.release = () => { window.isFree = true; held.forEach(acknowledge); };''')
            # At once when the first one is there: after two seconds the server takes them for shown. In one step: a drag may stand
            # still for so long that the server takes the view for one at rest.
            self.browser.execute_async_script('''const [done] = arguments; const { view } = isoscope; window.moved = null;
                import("./isoscope-view.js").then((m) => {
                  view.addEventListener('refined', () => {
                    if (moved || !view.progress) return;
                    moved = { count: view.progress.count, isExact: view.isExact, exact: view.stats().exactShown };
                    view.setCamera(m.turn(view.camera, 0.4, 0.1)); });
                  done(); });''')
            self.look(34000, 'moved && !isoscope.view.loop.stream.isDirty')
            self.js('release()')
            moved = self.js('return moved')
            self.assertGreater(moved['count'], 4)
            self.assertFalse(moved['isExact'])
            self.until('isoscope.view.isExact')
            self.assertEqual(moved['exact'] + 1, self.js('return isoscope.view.stats().exactShown'), 'the view before was drawn to its end')
            self.assert_exact()
            self.assertEqual((0, ''), tuple(self.js('const { bitmapsOpen, notice } = isoscope.view.stats(); return [bitmapsOpen, notice]')))

    def test_over_a_limit_the_level_is_shown_with_the_cost_and_the_button_draws_the_exact_picture(self):
        self.show_dark('&max-side=420')
        offer = '!document.getElementById("exact-offer").hidden'
        self.js('const field = document.getElementById("limit-gigabytes"); field.value = "0.0001"; field.onchange();')
        self.look(34000, offer)
        self.until('/^level [12], 1 sample = [0-9.]+ px$/.test(document.getElementById("state").textContent)')
        self.assertRegex(self.browser.find_element(By.ID, 'exact-cost').text, r'^exact: [0-9.]+ MB(, about [0-9.]+ s)?$')
        self.until('/exact-limit=10,0.0001/.test(location.hash)')
        self.assertFalse(self.js('return isoscope.view.isExact'))
        self.browser.find_element(By.ID, 'draw-exact').click()
        self.until(f'isoscope.view.isExact && !({offer})')
        self.assert_exact()
        self.look(35000, offer)
        field = 'const field = document.getElementById("limit-gigabytes"); field.value = "4"; field.onchange();'
        self.js(field)
        self.until(f'isoscope.view.isExact && !({offer})')
        self.assert_exact()

    def test_a_level_of_the_menu_is_exact_as_such_and_undone(self):
        self.show_dark('&max-side=420')
        self.assertEqual(['finest', 'spacing', '1', '2'],
                         self.js('return [...document.getElementById("level").options].map(({ value }) => value)'))
        choose = 'const menu = document.getElementById("level"); menu.value = arguments[0]; menu.onchange()'
        self.until_kept()
        self.js(choose, '2')
        self.until('isoscope.view.isExact && /level=2/.test(location.hash)')
        self.until('/^exact at level 2, 1 sample = [0-9.]+ px · /.test(document.getElementById("state").textContent)')
        self.assert_exact()
        coarse = self.picture()
        self.until('!document.getElementById("undo").disabled')
        self.js('document.getElementById("undo").click()')
        self.until('isoscope.view.isExact && !isoscope.view.state.level && isoscope.view.level === 0')
        self.assert_exact()
        self.assertLess(self.share_of_equal(coarse, self.picture()), 1)


class WarpTest(PageTest):
    """WebGL2 by the processor: the same shaders, slowly."""
    QUERY = '?theme=dark&max-side=420&renderer=webgl2'

    def test_the_picture_at_rest_is_exact_with_webgl_too(self):
        self.open_and_wait()
        self.assertEqual('webgl2', self.js('return isoscope.view.stats().renderer'))
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_the_last_frame_is_warped_to_the_pointer_s_camera_until_the_next_one_comes(self):
        self.open_and_wait()
        # The quick frame has the depths. On a busy machine it may come too late to be taken, unless it comes alone.
        self.gateway.control(mute=True)
        sequence = self.js('isoscope.view.update({ maxLayers: 1 }); return isoscope.view.loop.stream.sequence')
        self.until(f'isoscope.view.loop.stream.sequence > {sequence} && !isoscope.view.loop.stream.isDirty')
        self.gateway.control(answer=self.js('return isoscope.view.loop.stream.sequence'))
        self.until('isoscope.view.isCurrent && isoscope.view.loop.picture.frame.grid')
        self.gateway.control(mute=False)
        self.until_exact()
        before = self.picture()
        warps = self.js('return isoscope.view.stats().warpsDrawn')
        self.gateway.control(mute=True)
        # 5 degrees, which the server does not answer.
        self.js('const v = isoscope.view; window.turned = (dx) => import("./isoscope-view.js").then(m => v.setCamera(m.turn(v.camera, dx, 0)));'
                'turned(5 / 90);')
        self.until(f'isoscope.view.stats().warpsDrawn > {warps}')
        warped = self.picture()
        truth = self.reference()
        background = truth[2][0][0]
        covered = [(p, q) for row, other in zip(warped[2], truth[2]) for p, q in zip(row, other) if q != background]
        self.assertGreater(len(covered), 5000)
        close = sum(max(abs(i - j) for i, j in zip(p, q)) <= 40 for p, q in covered) / len(covered)
        print(f'warp by WebGL: {100 * close:.1f} % of {len(covered)} covered pixels look like the true picture', file=sys.stderr)
        self.assertGreater(close, 0.9)
        same = sum(max(abs(i - j) for i, j in zip(p, q)) <= 40 for row, other in zip(before[2], truth[2])
                   for p, q in zip(row, other) if q != background) / len(covered)
        self.assertGreater(close, same, 'the warp is no nearer to the truth than the old picture')
        self.gateway.control(mute=False)
        self.until_exact()
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_a_lost_graphics_context_falls_back_and_shows_the_picture_again(self):
        self.open_and_wait()
        self.js('isoscope.view.loop.picture.screen.canvas.getContext("webgl2").getExtension("WEBGL_lose_context").loseContext()')
        self.until('isoscope.view.stats().renderer === "bitmaprenderer" && isoscope.view.isExact')
        self.until('isoscope.view.stats().framesShown >= 2')
        self.until_exact()
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))


class WidgetTest(PageTest):
    """The default export, as anywidget calls it."""

    def test_render_shows_the_state_of_the_model_and_writes_it_back(self):
        self.open_and_wait()
        self.js('''window.model = { values: { url: location.origin + '/', height: 200, state: { dataset: 'ball', surfaces: [{ isovalue: 55 }] } },
              handlers: {}, saved: 0, get(name) { return this.values[name]; }, set(name, value) { this.values[name] = value; },
              save_changes() { this.saved += 1; }, on(name, f) { this.handlers[name] = f; }, off() {}, send() {} };
            const el = document.createElement('div'); el.id = 'cell'; el.style.width = '300px'; document.body.append(el);
            import('./isoscope-view.js').then((m) => { window.leave = m.default.render({ model, el }); });''')
        self.until('window.model.saved > 0 && model.values.state.camera && model.values.stats.isExact')
        self.assertEqual(55, self.js('return model.values.state.surfaces[0].isovalue'))
        self.js('model.values.state = { dataset: "ball", surfaces: [{ isovalue: 70 }] }; model.saved = 0; model.handlers["change:state"]();')
        self.until('model.saved > 0 && model.values.state.surfaces[0].isovalue === 70')
        self.js('window.leave()')
        self.assertEqual(0, self.js('return document.querySelectorAll("#cell .isoscope-view").length'))

    def test_frames_come_through_the_kernel_where_there_is_no_gateway(self):
        self.check_kernel('')

    def test_frames_come_through_the_kernel_where_the_gateway_is_out_of_reach(self):
        self.check_kernel(self.gateway.url)

    def check_kernel(self, url):
        self.open_and_wait()
        self.gateway.control(refuse=True)
        self.js('''window.sent = [];
            window.model = { values: { url: arguments[0], state: { dataset: 'ball', surfaces: [{ isovalue: 55 }] } },
              get(name) { return this.values[name]; }, set(name, value) { this.values[name] = value; }, save_changes() {},
              on(name, f) { if (name === 'msg:custom') window.fromKernel = f; }, off() {}, send(message) { sent.push(message); } };
            const el = document.createElement('div'); document.body.append(el);
            import('./isoscope-view.js').then((m) => m.default.render({ model, el }));''', url)
        self.until('sent.some((m) => m.type === "isoscope/interact" && JSON.parse(m.text).viewState)')
        self.js('''const state = JSON.parse(sent.filter((m) => m.text?.includes('viewState')).at(-1).text).viewState;
            const error = new TextEncoder().encode(JSON.stringify({ sequenceNumber: state.sequenceNumber, frameNumber: '1',
              error: { code: 9, message: 'from the kernel' } }));
            const bytes = new Uint8Array(4 + error.length); new DataView(bytes.buffer).setUint32(0, error.length, true);
            bytes.set(error, 4); fromKernel({ type: 'isoscope/frame' }, [new DataView(bytes.buffer)]);''')
        self.until('[...document.querySelectorAll(".isoscope-view")].some((e) => /From the kernel/.test(e.shadowRoot.textContent))')
        self.until('sent.some((m) => m.text?.includes("frameShown"))')


def told_of(test, trace):
    """One line: the test, where it failed, and why."""
    lines = [line for line in trace.splitlines() if line.strip()]
    frames = [i for i, line in enumerate(lines) if line.startswith('  File "')]
    why = next((i for i in range(max(frames, default=0), len(lines)) if not lines[i].startswith(' ')), len(lines) - 1)
    places = [lines[i].split(', in ')[0].strip() for i in frames if f'{os.path.basename(sys.argv[0])}"' in lines[i]]
    words = [lines[why][:400]] + ([f'... {lines[-1][-300:]}'] if why < len(lines) - 1 else [])
    return f'FAILED {test.id()}: {" ".join(words)}{f" ({places[-1]})" if places else ""}'


def main():
    """Runs the tests of the program. The last lines name those that failed: of a long output a CI shows only the end."""
    result = unittest.main(verbosity=2, exit=False).result
    for test, trace in result.failures + result.errors:
        print(told_of(test, trace), file=sys.stderr)
    sys.exit(not result.wasSuccessful())


if __name__ == '__main__':
    if missing():
        skips.skip_program('browser', 'the page is tested in one, and these are missing: ' + ', '.join(missing()))
    main()
