#!/usr/bin/env python3
"""What holds the page together, in a real browser: the door, links, undo, panels, phones, pixels, downloads.

    browser_page_test.py [unittest arguments]

Against mock_gateway.mjs, and against a real `isoscope view` where ISOSCOPE_BIN has one. Ends with 77 (skipped) where
browser_test.py does.
"""
import contextlib
import unittest
import urllib.parse

import browser_test as base
from browser_test import skips

if base.webdriver is not None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys


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
        self.assertEqual(['L', 'P', 'S'], [one.text for one in self.browser.find_elements(By.CSS_SELECTOR, '#clip .double > span:first-child')])
        self.open_and_wait('#dataset=ball&surface=40')
        self.until('document.querySelector("#quantity option[value=z]").textContent === "position z"')
        self.assertEqual(['x', 'y', 'z'], [one.text for one in self.browser.find_elements(By.CSS_SELECTOR, '#clip .double > span:first-child')])

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
