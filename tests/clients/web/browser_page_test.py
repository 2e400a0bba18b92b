#!/usr/bin/env python3
"""What holds the page together, in a real browser: the door, links, undo, panels, phones, pixels, downloads.

    browser_page_test.py [unittest arguments]

Against mock_gateway.mjs, and against a real `isoscope view` where ISOSCOPE_BIN has one. Ends with 77 (skipped) where
browser_test.py does.
"""
import contextlib
import time
import unittest
import urllib.parse

import browser_test as base
from browser_test import skips

if base.webdriver is not None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys


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


class DoorTest(base.PageTest):
    TOKEN = base.TokenTest.TOKEN
    IS_CLOSED = '!document.getElementById("door").hidden'

    def setUp(self):
        super().setUp()
        self.gateway.control(token=self.TOKEN)

    @contextlib.contextmanager
    def another_tab(self):
        """A tab of its own has no token of before."""
        first = self.browser.current_window_handle
        self.browser.switch_to.new_window('tab')
        try:
            yield
        finally:
            self.browser.close()
            self.browser.switch_to.window(first)

    def enter(self, text):
        field = self.browser.find_element(By.ID, 'door-token')
        field.clear()
        field.send_keys(text, Keys.ENTER)

    def test_a_link_opened_elsewhere_asks_for_the_token_once_and_then_shows_its_view(self):
        with self.another_tab():
            self.open('#dataset=ball&surface=65:1,0,0', query='?theme=dark&max-side=420')
            self.until(f'{self.IS_CLOSED} && document.getElementById("door-sentence").textContent')
            self.assertIn('needs its token', self.browser.find_element(By.ID, 'door-sentence').text)
            self.assertTrue(self.js('return document.getElementById("toast").hidden && isoscope.view.stats().notice === ""'),
                            'a second message beside the door')
            self.assertTrue(self.js('return document.querySelector("main").inert && document.activeElement.id === "door-token"'))
            self.enter('wrong')
            self.until('/not the token/.test(document.getElementById("door-sentence").textContent)')
            self.assertTrue(self.js(f'return {self.IS_CLOSED}'))
            self.enter(self.TOKEN)
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
            self.assertFalse(self.js('return document.querySelector("main").inert'))
            self.assertNotIn('token', self.browser.current_url)
            self.browser.refresh()
            self.until('isoscope.view.isExact')
            self.assertFalse(self.js(f'return {self.IS_CLOSED}'), 'a reload asks again')

    def test_the_door_takes_the_whole_address_that_was_printed(self):
        with self.another_tab():
            self.open(query='?theme=dark&max-side=420')
            self.until(self.IS_CLOSED)
            self.enter(f'{self.gateway.url}?token={urllib.parse.quote(self.TOKEN, safe="")}&dataset=ball')
            self.until('isoscope.view.isExact')

    def test_a_tab_of_before_a_restart_takes_the_refusal_at_once_and_asks_for_the_new_token(self):
        with self.another_tab():
            self.open_and_wait('#dataset=ball&surface=55', query=base.TokenTest.QUERY)
            self.gateway.control(token='of-the-next-start', drop=[1001, ''])
            self.until(self.IS_CLOSED)
            self.assertNotIn('Trying again', self.notice())
            attempts = 'isoscope.view.loop.connection.attempt'
            before = self.js(f'return {attempts}')
            base.time.sleep(1.5)  # the first attempts were half a second and a second apart
            self.assertEqual(before, self.js(f'return {attempts}'), 'a refused token is tried again and again')
            self.enter('of-the-next-start')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([55], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))

    def test_a_link_with_access_opens_without_a_question_and_keeps_the_token_out_of_every_address(self):
        self.open_and_wait('#dataset=ball&surface=65', query=base.TokenTest.QUERY)
        self.js('navigator.clipboard.writeText = async (text) => { window.copied = text; };')
        self.browser.find_element(By.ID, 'link-access').click()
        self.until('window.copied')
        copied = urllib.parse.urlsplit(self.js('return window.copied'))
        self.assertNotIn('token', copied.query)
        self.assertEqual(self.TOKEN, dict(urllib.parse.parse_qsl(copied.fragment))['token'])
        self.gateway.control(reset=True)
        with self.another_tab():
            self.browser.get(copied.geturl())
            self.until('isoscope.view.isExact')
            self.assertNotIn('token', self.browser.current_url)
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertEqual('', self.js('return document.getElementById("toast").textContent'), 'the token is no wrong part of the link')
        self.assertEqual([], [one for one in self.gateway.control()['targets'] if 'token' in one])

    def test_a_link_with_access_opens_the_door_of_a_tab_that_waits_for_a_token(self):
        with self.another_tab():
            self.open('#dataset=ball&surface=55', query='?theme=dark&max-side=420')
            self.until(self.IS_CLOSED)
            self.js('location.hash = arguments[0]', f'#dataset=ball&surface=65&token={urllib.parse.quote(self.TOKEN, safe="")}')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertNotIn('token', self.browser.current_url)
            self.assertEqual(4, self.js('return document.getElementById("dataset").options.length'), 'only the dataset of the link is listed')

    def test_the_door_stands_before_an_open_dialog(self):
        with self.another_tab():
            self.open_and_wait('#dataset=ball&surface=55', query=base.TokenTest.QUERY)
            self.browser.find_element(By.ID, 'save').click()
            self.until('document.getElementById("dialog").open')
            self.gateway.control(token='of-the-next-start', drop=[1001, ''])
            self.until(f'{self.IS_CLOSED} && !document.getElementById("dialog").open')
            self.enter('of-the-next-start')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')

    def test_without_a_token_there_is_no_link_with_access(self):
        self.gateway.control(token=None)
        with self.another_tab():
            self.open_and_wait(query='?theme=dark&max-side=420')
            self.assertTrue(self.js('return document.getElementById("link-access").hidden'))


class ChoiceTest(base.PageTest):
    def test_a_wrong_dataset_of_a_link_offers_those_that_there_are(self):
        self.open('#dataset=gone&surface=1')
        self.until('!document.getElementById("choice").hidden')
        choice = self.browser.find_element(By.ID, 'choice')
        self.assertIn('There is no dataset “gone” here.', choice.text)
        self.assertEqual(['ball', 'patient', 'flow', 'organs'], [one.text for one in choice.find_elements(By.TAG_NAME, 'button')])
        choice.find_element(By.CSS_SELECTOR, '[title=patient]').click()
        self.until('isoscope.view.isExact && document.getElementById("choice").hidden')
        state = self.js('return isoscope.view.getState()')
        # An isovalue of other samples is not kept.
        self.assertEqual(('patient', 40), (state['dataset'], state['surfaces'][0]['isovalue']))

    def test_the_same_volume_under_another_name_keeps_the_view_of_the_link(self):
        self.open('#dataset=Ball-0123456789abcdef&surface=65')
        self.until('!document.getElementById("choice").hidden')
        self.browser.find_element(By.CSS_SELECTOR, '#choice [title=ball]').click()
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "ball"')
        self.assertEqual(65, self.js('return isoscope.view.state.surfaces[0].isovalue'))


class UndoTest(base.PageTest):
    # Whether the buttons of undo and redo can be pressed.
    BUTTONS = '[...document.querySelectorAll("#undo, #redo")].map((button) => !button.disabled).join()'

    def press(self, *keys):
        actions = base.ActionChains(self.browser)
        for key in keys[:-1]:
            actions = actions.key_down(key)
        actions = actions.send_keys(keys[-1])
        for key in keys[:-1]:
            actions = actions.key_up(key)
        actions.perform()

    def until_eye(self, eye):
        self.until(f'isoscope.view.isExact && Math.hypot(...isoscope.view.camera.eye.map((v, i) => v - {eye}[i])) < 1e-9')

    def test_a_drag_is_one_entry_and_keys_and_buttons_go_back_and_forth(self):
        self.open_and_wait()
        first, eye = self.picture(), self.js('return isoscope.view.camera.eye')
        base.time.sleep(0.6)  # the first view rests, and is an entry
        self.assertEqual('false,false', self.js(f'return {self.BUTTONS}'))
        self.drag(120, 40, steps=12)
        self.until(f'{self.BUTTONS} === "true,false"')
        turned = self.js('return isoscope.view.camera.eye')
        self.press(Keys.CONTROL, 'z')
        self.until_eye(eye)
        self.assertEqual('false,true', self.js(f'return {self.BUTTONS}'), 'a drag is more than one entry')
        self.assertEqual(1, self.share_of_equal(self.picture(), first))
        self.press(Keys.CONTROL, Keys.SHIFT, 'z')
        self.until_eye(turned)
        self.browser.find_element(By.ID, 'undo').click()
        self.until_eye(eye)
        self.press(Keys.CONTROL, 'y')
        self.until_eye(turned)

    def test_settings_come_back_and_a_new_change_ends_the_way_forward(self):
        self.open_and_wait()
        base.time.sleep(0.6)
        for isovalue in (60, 70):
            self.js('isoscope.view.update({ surfaces: [{ isovalue: arguments[0] }] })', isovalue)
            base.time.sleep(0.6)
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].isovalue === 60')
        self.until('document.querySelector("#surfaces input[type=number]").value === "60"')
        self.js("const menu = document.getElementById('samples'); menu.value = '4'; menu.dispatchEvent(new Event('change'));")
        self.until(f'{self.BUTTONS} === "true,false"')
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && !isoscope.view.state.samples')

    def test_undo_goes_back_to_the_dataset_before(self):
        self.open_and_wait('#dataset=ball&surface=55')
        base.time.sleep(0.6)
        self.js("const menu = document.getElementById('dataset'); menu.value = 'patient'; menu.dispatchEvent(new Event('change'));")
        self.until(f'isoscope.view.isExact && isoscope.view.state.dataset === "patient" && {self.BUTTONS} === "true,false"')
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "ball" && document.getElementById("dataset").value === "ball"')
        self.assertEqual(55, self.js('return isoscope.view.state.surfaces[0].isovalue'))


class HelpTest(base.PageTest):
    def test_the_key_and_the_button_show_moves_keys_and_the_version(self):
        self.open_and_wait()
        self.js('isoscope.view.root.focus()')
        base.ActionChains(self.browser).send_keys('?').perform()
        self.until('document.getElementById("help").open')
        text = self.browser.find_element(By.ID, 'help').text
        for word in ('Mouse', 'Touch', 'Keys', 'two fingers', 'Ctrl-Z', 'Isoscope 1.2.3'):
            self.assertIn(word.lower(), text.lower())
        base.ActionChains(self.browser).send_keys(Keys.ESCAPE).perform()
        self.until('!document.getElementById("help").open')
        self.browser.find_element(By.ID, 'help-open').click()
        self.until('document.getElementById("help").open')

    def test_in_a_field_the_key_is_a_character(self):
        self.open_and_wait('#dataset=organs&label=1')
        self.until('!document.getElementById("labels").hidden')
        self.browser.find_element(By.ID, 'label-set').send_keys('?')
        self.assertFalse(self.js('return document.getElementById("help").open'))


class NameTest(base.PageTest):
    def test_axes_are_those_of_the_patient_wherever_they_are_named(self):
        self.open_and_wait('#dataset=patient&surface=40&color-by=z:viridis')
        self.until('document.querySelector("#clip [aria-valuetext]") && !document.getElementById("legend").hidden')
        self.assertEqual(['position L', 'position P', 'position S'],
                         self.js('return ["x", "y", "z"].map((one) => document.querySelector(`#quantity option[value=${one}]`).textContent)'))
        self.assertIn('position S', self.browser.find_element(By.ID, 'legend').text)
        self.assertEqual(['L', 'P', 'S'], self.clip_names())
        self.open_and_wait('#dataset=ball&surface=40')
        self.until('document.querySelector("#quantity option[value=z]").textContent === "position z"')
        self.assertEqual(['x', 'y', 'z'], self.clip_names())

    def clip_names(self):
        return self.js('return [...document.querySelectorAll("#clip .double > span:first-child")].map((one) => one.textContent)')

    def test_surfaces_are_told_apart_by_colour(self):
        self.open_and_wait()
        self.browser.find_element(By.ID, 'add').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 2')
        self.assertEqual(['#dcc8b4', '#56b4e9'], self.colors())
        self.open_and_wait('#dataset=ball&isovalue=30,60,80')
        self.until('document.querySelectorAll("#surfaces li").length === 3')
        self.assertEqual(['#dcc8b4', '#56b4e9', '#d55e00'], self.colors())

    def colors(self):
        return self.js('return [...document.querySelectorAll("#surfaces input[type=color]")].map((one) => one.value)')

    def test_the_two_opacities_of_a_colour_map_have_labels_of_their_own(self):
        self.open_and_wait('#dataset=ball&surface=40&color-by=z:viridis::0.5,1')
        self.until('document.querySelector("[for=opacity-min]").offsetHeight > 0')
        rows = self.js('return ["min", "max"].map((end) => document.getElementById(`opacity-${end}`).parentElement.textContent.trim())')
        self.assertEqual(['Opacity, low50 %', 'Opacity, high100 %'], rows)


class NoteTest(base.PageTest):
    def test_an_isovalue_beyond_the_samples_says_so_at_once_with_their_range(self):
        # Also by a server that tells no reasons.
        self.gateway.control(features=None)
        self.open_and_wait('#dataset=ball&surface=400')
        notes = 'document.getElementById("notes")'
        self.until(f'{notes}.textContent === "Isovalue 400 has no surface: the samples are from 0 to 100."')
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 40 }] })')
        self.until(f'isoscope.view.isExact && {notes}.hidden')
        self.open_and_wait('#dataset=flow&surface=-5&field=velocity:x')
        self.until(f'{notes}.textContent === "Isovalue -5 has no surface: the samples are from -2 to 50 m/s."')

    def test_what_the_page_says_by_itself_is_not_said_again_by_the_server(self):
        self.gateway.control(note='isovalue 400 has no surface: so says the server')
        self.open_and_wait('#dataset=ball&surface=400')
        self.until('!document.getElementById("notes").hidden')
        self.assertNotIn('so says the server', self.browser.find_element(By.ID, 'notes').text)


class ChosenLabelTest(base.PageTest):
    def show(self, dataset):
        self.js("const menu = document.getElementById('dataset'); menu.value = arguments[0]; menu.dispatchEvent(new Event('change'));", dataset)
        self.until(f'isoscope.view.isExact && isoscope.view.state.dataset === "{dataset}" && isoscope.view.dataset?.name === "{dataset}"')

    def test_a_chosen_label_is_forgotten_with_its_dataset(self):
        self.open_and_wait('#dataset=organs&label=1')
        self.until('document.querySelector("#label-list button.name")')
        self.browser.find_element(By.CSS_SELECTOR, '#label-list button.name').click()
        self.until('!document.getElementById("label-actions").hidden')
        self.show('ball')
        self.until('document.getElementById("labels").hidden')
        self.show('organs')
        self.until('!document.getElementById("labels").hidden')
        self.assertTrue(self.js('return document.getElementById("label-actions").hidden'))


class PointTest(base.PageTest):
    def pick(self, x, y):
        count = self.js('return isoscope.view.loop.overlay.pins.length')
        view = self.browser.find_element(By.ID, 'view')
        base.ActionChains(self.browser).move_to_element_with_offset(view, x, y).click().perform()
        self.until(f'isoscope.view.loop.overlay.pins.length === {min(2, count + 1)}')

    def stale(self):
        return self.js('return isoscope.view.loop.overlay.pins.map((pin) => Boolean(pin.isStale))')

    def test_points_of_another_isovalue_fade_and_come_back_with_it(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.pick(10, 10)
        self.assertEqual([False], self.stale())
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 60 }] })')
        self.until('isoscope.view.loop.overlay.pins[0].isStale && isoscope.view.isExact')
        self.assertEqual(1, len(self.browser.find_elements(By.CSS_SELECTOR, '#points .stale')))
        pixel = base.ControlTest.PIXEL
        self.until(f'{pixel}(10, 10)[3] > 0 && {pixel}(10, 10)[3] < 200')
        self.pick(-20, 15)
        self.assertEqual([True, False], self.stale())
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 40 }] })')
        self.until('!isoscope.view.loop.overlay.pins[0].isStale')
        self.assertEqual([False, True], self.stale())

    def test_points_of_another_step_fade(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.pick(5, 5)
        self.browser.find_element(By.ID, 'step-on').click()
        self.until('isoscope.view.loop.overlay.pins[0].isStale')

    def test_the_panel_has_units_and_names_of_axes_and_no_numbers_of_blocks(self):
        self.open_and_wait('#dataset=patient&surface=40')
        self.pick(10, 10)
        text = self.browser.find_element(By.ID, 'points').text
        self.assertRegex(text, r'L, P, S\s+[-0-9.,]+, [-0-9.,]+, [-0-9.,]+ mm')
        for word in ('block', 'shard'):
            self.assertNotIn(word, text)
        self.open_and_wait('#dataset=flow&surface=40&step=3')
        self.pick(0, 0)
        self.assertRegex(self.browser.find_element(By.ID, 'points').text, r'value\s+40 Pa')

    def test_points_are_copied_as_a_table_with_all_digits(self):
        self.open_and_wait('#dataset=patient&surface=40')
        self.pick(10, 10)
        self.pick(-40, 20)
        self.js('navigator.clipboard.writeText = async (text) => { window.copied = text; };')
        self.browser.find_element(By.ID, 'points-copy').click()
        self.until('window.copied')
        titles, a, b = [line.split(',') for line in self.js('return window.copied').splitlines()]
        self.assertEqual(['point', 'L (mm)', 'P (mm)', 'S (mm)', 'value', 'normal L', 'normal P', 'normal S'], titles)
        pins = self.js('return isoscope.view.loop.overlay.pins.map((pin) => pin.position)')
        for name, row, position in (('A', a, pins[0]), ('B', b, pins[1])):
            self.assertEqual((name, '40'), (row[0], row[4]))
            self.assertEqual(position, [float(cell) for cell in row[1:4]])

    def test_the_panel_is_moved_by_a_drag_and_by_keys_and_stays_within_the_picture(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.pick(10, 10)
        panel, handle = self.browser.find_element(By.ID, 'points'), self.browser.find_element(By.ID, 'points-handle')
        before, grip = panel.rect, 15 - handle.size['width'] // 2
        base.ActionChains(self.browser, duration=10).move_to_element_with_offset(handle, grip, 0).click_and_hold().move_by_offset(150, 90).release().perform()
        moved = panel.rect
        self.assertEqual((before['x'] + 150, before['y'] + 90), (moved['x'], moved['y']))
        handle.send_keys(Keys.ARROW_LEFT)
        self.assertEqual(moved['x'] - 16, panel.rect['x'])
        base.ActionChains(self.browser, duration=10).move_to_element_with_offset(handle, grip, 0).click_and_hold().move_by_offset(-400, -300).release().perform()
        stage = self.browser.find_element(By.ID, 'stage').rect
        self.assertEqual((stage['x'], stage['y']), (panel.rect['x'], panel.rect['y']))
        self.assertEqual(1, len(self.js('return isoscope.view.loop.overlay.pins')), 'a drag of the panel picks')


class SentenceTest(base.PageTest):
    BOXES = '''const box = (element) => { const { left, top, right, bottom } = element.getBoundingClientRect(); return [left, top, right, bottom]; };
        return [document.getElementById('timeline'), document.getElementById('toast'), isoscope.view.loop.elements.notice].map(box);'''

    @staticmethod
    def overlap(a, b):
        return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]

    def test_sentences_leave_the_time_bar_free_at_every_size(self):
        for width, height in ((1440, 900), (900, 700), (390, 844)):
            with self.subTest(f'{width} x {height}'), size_of(self.browser, width, height):
                self.open_and_wait('#dataset=flow&surface=40&step=1&nonsense=1')
                self.until('!document.getElementById("toast").hidden && !document.getElementById("timeline").hidden')
                self.js("isoscope.view.loop.notices.problem('The server says something of a usual length, which takes more than a line.')")
                bar, toast, notice = self.js(self.BOXES)
                self.assertGreater(toast[3], toast[1])
                self.assertFalse(self.overlap(bar, toast), f'{bar} and the toast {toast}')
                self.assertFalse(self.overlap(bar, notice), f'{bar} and the notice {notice}')


class PhoneTest(base.PageTest):
    def test_a_phone_has_fit_and_views_and_targets_for_fingers(self):
        with size_of(self.browser, 390, 844, is_touch=True):
            self.open_and_wait('#dataset=patient&surface=40:1,0,0:0.5&surface=70&color-by=z:viridis&clip-plane=0.5,0.25,1,20')
            self.until('document.querySelector("[data-view=fit]") && document.querySelector("#clip [aria-valuetext]")')
            self.assertTrue(self.js('return matchMedia("(pointer: coarse)").matches'))
            small = self.js('''return [...document.querySelectorAll('button, select, input, .switch, .thumb')]
                .map((element) => element.closest('.switch') ?? element.closest('.slider') ?? element)
                .filter((element) => element.offsetParent !== null && !element.closest('dialog'))
                .map((element) => [element.id || element.className || element.textContent, element.getBoundingClientRect().height])
                .filter(([, height]) => height < 44)''')
            self.assertEqual([], small)
            self.assertTrue(self.js('const box = document.querySelector("[data-view=fit]").getBoundingClientRect(); return box.left >= 0 && box.right <= 390'))
            eye = self.js('return isoscope.view.camera.eye')
            self.browser.find_element(By.CSS_SELECTOR, '[data-view=anterior]').click()
            self.until(f'isoscope.view.isExact && isoscope.view.camera.eye[1] !== {eye[1]}')
            self.assertFalse(self.js('return document.documentElement.scrollWidth > 390'), 'the page is wider than the phone')


class PixelTest(base.PageTest):
    QUERY = '?theme=dark'
    # The canvas of the picture, in its own pixels and in those of the device.
    CANVAS = '''const { canvas } = isoscope.view.loop.picture.screen; const box = canvas.getBoundingClientRect();
        return [canvas.width, canvas.height, Math.round(box.width * devicePixelRatio), Math.round(box.height * devicePixelRatio)];'''

    def state_text(self):
        return self.browser.find_element(By.ID, 'state').text

    def test_at_rest_the_picture_has_the_pixels_of_the_device_and_is_called_exact(self):
        for width, height, scale in ((700, 420, 1), (500, 300, 2), (430, 300, 1.5)):
            with self.subTest(f'{width} x {height} @{scale}'), size_of(self.browser, width, height, scale):
                self.open_and_wait('#dataset=ball&surface=40')
                self.until('/^exact/.test(document.getElementById("state").textContent)')
                across, down, device_across, device_down = self.js(self.CANVAS)
                # The browser snaps the edges of the element to pixels.
                self.assertLessEqual(max(abs(device_across - across), abs(device_down - down)), 1)
                self.assertEqual(f'exact · {across} × {down}', self.state_text())
                self.assertEqual('pixelated', self.js('return getComputedStyle(isoscope.view.loop.picture.screen.canvas).imageRendering'))
                self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_a_picture_of_more_than_2048_pixels_is_drawn_where_the_server_allows_it(self):
        with size_of(self.browser, 1400, 120, 2):
            self.open_and_wait('#dataset=ball&surface=40')
            self.until('isoscope.view.stats().width > 2048')
            self.until('/^exact/.test(document.getElementById("state").textContent)')

    def test_a_picture_that_the_screen_scales_is_not_called_exact(self):
        self.gateway.control(maxViewportPx=300)
        self.open_and_wait('#dataset=ball&surface=40')
        self.until('isoscope.view.isExact && /^scaled from 300 ×/.test(document.getElementById("state").textContent)')
        self.assertEqual('auto', self.js('return getComputedStyle(isoscope.view.loop.picture.screen.canvas).imageRendering'))
        self.open_and_wait('#dataset=ball&surface=40', query='?theme=dark&max-side=420')
        self.until('/^scaled from 420 ×/.test(document.getElementById("state").textContent)')

    def test_a_server_without_memory_for_all_pixels_is_asked_for_fewer_and_for_all_once_less_is_shown(self):
        with size_of(self.browser, 1100, 700):
            self.open_and_wait('#dataset=ball&surface=40:1,0,0:0.5&surface=70')
            whole = self.js('return [isoscope.view.stats().width, isoscope.view.stats().height]')
            self.gateway.control(mostPixels=whole[0] * whole[1] * 0.6)
            self.js('isoscope.view.update({ samples: 4 })')
            self.until('isoscope.view.isExact && /^scaled from/.test(document.getElementById("state").textContent)')
            self.assertLess(self.js('return isoscope.view.stats().width'), whole[0])
            self.assertEqual('', self.notice())
            self.gateway.control(mostPixels=None)
            self.js('isoscope.view.update({ samples: undefined })')
            self.until(f'isoscope.view.isExact && isoscope.view.stats().width === {whole[0]}')
            self.until('/^exact/.test(document.getElementById("state").textContent)')


    def test_a_server_whose_queue_is_full_is_asked_again_for_all_pixels(self):
        with size_of(self.browser, 1100, 700):
            self.open_and_wait('#dataset=ball&surface=40')
            whole = self.js('return isoscope.view.stats().width')
            self.gateway.control(fail={'code': 8, 'message': 'the queue is full', 'reason': 'TOO_BUSY', 'retryDuration': '0.300s'},
                                 reset=True)
            self.js('isoscope.view.update({ samples: 4 })')
            end = time.monotonic() + base.PATIENCE_S
            while self.gateway.control()['states'] < 4 and time.monotonic() < end:
                time.sleep(0.05)
            self.assertGreaterEqual(self.gateway.control()['states'], 4)
            self.assertEqual(whole, self.gateway.control()['last']['frame']['viewport']['widthPx'])
            self.gateway.control(fail=None)
            self.until(f'isoscope.view.isExact && isoscope.view.stats().width === {whole}')
            self.assertEqual('', self.notice())


class SmoothTest(PixelTest):
    """WebGL2 by the processor: the same shaders, slowly."""
    QUERY = '?theme=dark&renderer=webgl2'

    def test_a_moving_frame_is_enlarged_without_blocks(self):
        with size_of(self.browser, 700, 420):
            self.open_and_wait('#dataset=ball&surface=40')
            self.assertEqual('webgl2', self.js('return isoscope.view.stats().renderer'))
            # A frame of 8 x 6 pixels, of which every second column is white.
            self.js('''const small = document.createElement('canvas'); small.width = 8; small.height = 6;
                const context = small.getContext('2d'); context.fillStyle = '#000'; context.fillRect(0, 0, 8, 6);
                context.fillStyle = '#fff'; for (let x = 0; x < 8; x += 2) context.fillRect(x, 0, 1, 6);
                return createImageBitmap(small).then((bitmap) => { const { picture } = isoscope.view.loop;
                  picture.show(bitmap, { width: 8, height: 6, camera: isoscope.view.camera, grid: null, isExact: false, background: [0, 0, 0] }); });''')
            width, height, rows = self.picture()
            middle = [pixel[0] for pixel in rows[height // 2][2 * width // 5:3 * width // 5]]
            steps = [abs(a - b) for a, b in zip(middle, middle[1:])]
            self.assertGreater(max(middle) - min(middle), 60)
            self.assertLess(max(steps), 40, 'pixels of the small frame have edges')


class RangeTest(base.PageTest):
    RANGE = 'isoscope.view.state.surfaces[0].colorBy.range'

    def test_colours_take_the_range_of_the_step_and_that_of_all_steps(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1&color-by=velocity:x:viridis')
        self.until('document.getElementById("range-step").offsetHeight > 0')
        self.gateway.control(reset=True)
        self.browser.find_element(By.ID, 'range-step').click()
        # The mock counts samples from 0 to 100 at each step; over all steps they are -2 to 50.
        self.until(f'isoscope.view.isExact && {self.RANGE}')
        self.assertEqual({'min': 0, 'max': 50}, self.js(f'return {self.RANGE}'))
        self.assertIn('/v1/datasets/flow/histogram?bins=4096&field=velocity&component=x&step=1', self.gateway.control()['targets'])
        self.browser.find_element(By.ID, 'range-all').click()
        self.until(f'isoscope.view.isExact && {self.RANGE}.min === -2')
        self.assertEqual({'min': -2, 'max': 50}, self.js(f'return {self.RANGE}'))
        self.until('document.getElementById("range-min").value === "-2" && document.getElementById("range-max").value === "50"')

    def test_another_field_keeps_the_material_of_the_first_look(self):
        self.open_and_wait('#dataset=flow')
        material = self.js('return isoscope.view.state.surfaces[0].material')
        self.assertTrue(material)
        self.js("const menu = document.getElementById('field'); menu.value = 'velocity:x'; menu.dispatchEvent(new Event('change'));")
        self.until('isoscope.view.isExact && isoscope.view.state.selection?.field === "velocity"')
        self.assertEqual(material, self.js('return isoscope.view.state.surfaces[0].material'))
        self.until('/&material=soft/.test(location.hash)')

    def test_a_position_has_no_steps(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1&color-by=z:viridis')
        self.until('document.getElementById("map").offsetHeight > 0')
        self.assertEqual(0, self.js('return document.getElementById("range-step").offsetHeight'))

    def test_a_step_that_a_field_lacks_has_no_range(self):
        self.open_and_wait('#dataset=flow&surface=40&step=5&color-by=velocity:x:viridis')
        self.until('document.getElementById("range-step").offsetHeight > 0')
        self.assertTrue(self.js('return document.getElementById("range-step").disabled'))


class RealDoorTest(base.RealPageTest):
    def test_a_wrong_token_meets_the_door_and_the_right_one_the_picture(self):
        address = urllib.parse.urlsplit(self.page)
        query = dict(urllib.parse.parse_qsl(address.query))
        self.browser.get('about:blank')
        self.browser.get(f'{address.scheme}://{address.netloc}/?max-side=420&token=old#dataset={query["dataset"]}&surface=90')
        self.until('!document.getElementById("door").hidden')
        self.assertEqual('', self.notice())
        self.browser.find_element(By.ID, 'door-token').send_keys(query['token'], Keys.ENTER)
        self.until('isoscope.view.isExact && document.getElementById("door").hidden')
        self.assertEqual(90, self.js('return isoscope.view.state.surfaces[0].isovalue'))


if __name__ == '__main__':
    if base.missing():
        skips.skip_program('browser', 'the page is tested in one, and these are missing: ' + ', '.join(base.missing()))
    unittest.main(verbosity=2)
