// The elements around the picture: tools, notes, the selected object, and a text list of objects.
export const template = `
<div class="somrs-scene" :style="{ height }" :class="{ 'somrs-scene-listing': listOpen && !none }">
  <div v-if="none" class="somrs-scene-none" role="alert">
    <q-icon name="view_in_ar" size="32px" aria-hidden="true"/>
    <p>This browser cannot show the 3D view: WebGL is missing or disabled.</p>
    <p><a href="/map">The floor plan on the Map page</a> shows the same from above; the list below describes it.</p>
  </div>
  <div v-show="!none" class="somrs-scene-view" ref="view" tabindex="0" role="application" aria-roledescription="3D view"
       :aria-label="words" :aria-describedby="id + '-keys'" @keydown="key">
    <canvas ref="canvas" aria-hidden="true"></canvas>
    <div class="somrs-scene-labels" ref="labels" aria-hidden="true"></div>
  </div>
  <p :id="id + '-keys'" class="somrs-scene-hidden">Arrow keys turn the view, with Shift they move it, plus and minus zoom, F shows all,
    T looks from above, Escape ends following and selecting. The button List opens a text list of the objects.</p>
  <div v-show="!none" class="somrs-scene-tools" role="toolbar" aria-label="View">
    <q-btn v-for="one in tools" :key="one.label" flat dense :icon="one.icon" :aria-label="one.label" :aria-pressed="one.pressed"
           :class="{ 'somrs-scene-pressed': one.pressed }" @click="one.act"><q-tooltip :delay="400">{{ one.tip }}</q-tooltip></q-btn>
    <label v-if="storeys.length > 1"><span class="somrs-scene-hidden">Storey</span>
      <select :value="storeys.indexOf(shownStorey)" @change="setStorey($event.target.value)"><option :value="-1">All storeys</option>
        <option v-for="(one, i) in storeys" :key="one.z + one.name" :value="i">{{ one.name }}</option></select></label>
    <label v-if="robots.length"><span class="somrs-scene-hidden">Follow</span>
      <select :value="following ?? ''" @change="setFollowed($event.target.value || null)" :class="{ 'somrs-scene-pressed': following }">
        <option value="">Follow nothing</option>
        <option v-if="following && !robots.includes(following)" :value="following">Follow {{ following }}</option>
        <option v-for="name in robots" :key="name" :value="name">Follow {{ name }}</option></select></label>
  </div>
  <div class="somrs-scene-notes" role="status">
    <div v-if="trouble" class="somrs-scene-note"><q-icon name="sync_problem"/> {{ trouble }}</div>
    <div v-else-if="!alive" class="somrs-scene-note"><q-icon name="sync_problem"/> The simulator does not answer: the last known positions are shown.</div>
    <div v-if="problems.length" class="somrs-scene-note"><q-icon name="warning"/> {{ problems.length }} not drawn: {{ problems[0] }}</div>
  </div>
  <div v-if="card" class="somrs-scene-card">
    <div><strong>{{ card.title }}</strong> <span class="somrs-soft">{{ card.type }}</span></div>
    <div>{{ card.words }}</div>
    <div><button v-if="following !== card.name" type="button" @click="setFollowed(card.name)">Follow</button>
      <button type="button" @click="select(null)" :aria-label="'Close ' + card.name">Close</button></div>
  </div>
  <section v-if="listOpen || none" class="somrs-scene-list" :class="{ 'somrs-scene-list-alone': none }" aria-label="Object list">
    <input v-model="wanted" type="search" placeholder="Find by name or type" aria-label="Find by name or type" @input="tell">
    <ul><li v-for="row in rows.rows" :key="row.name">
      <button type="button" :aria-pressed="row.name === selected" @click="find(row.name)"><b>{{ row.name }}</b> {{ row.words }}</button></li></ul>
    <p v-if="rows.more" class="somrs-soft">and {{ rows.more }} more</p>
    <p v-if="!rows.rows.length" class="somrs-soft">No matches.</p>
  </section>
</div>`;
