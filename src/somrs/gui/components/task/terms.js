// The services asked for each step, their terms and the result: a table that grows.

const MOST = 200; // rows shown at first

export default {
  template: `
    <div>
      <p v-if="!rows.length" class="somrs-soft somrs-terms-none">No service was asked for terms.</p>
      <div v-else class="somrs-terms-view" tabindex="0" role="group" aria-label="Terms by step">
        <table class="somrs-terms">
          <thead><tr><th v-for="name in ['Service', 'Price', 'Takes', 'From – until', 'Valid until']" :key="name" scope="col">{{ name }}</th></tr></thead>
          <tbody v-for="step in steps" :key="step.name">
            <tr class="somrs-terms-step"><th colspan="5" scope="rowgroup">{{ step.name }}</th></tr>
            <tr v-for="row in step.rows" :key="row.key" :class="['somrs-tone-' + row.tone, {'somrs-terms-chosen': row.chosen}]">
              <th scope="row"><div class="somrs-terms-who"><i class="material-icons" aria-hidden="true">{{ row.icon }}</i><div>
                <div class="somrs-terms-service">{{ row.service }}</div><div class="somrs-terms-word">{{ row.word }}</div>
                <div v-if="row.why" class="somrs-soft">{{ row.why }}</div></div></div></th>
              <td>{{ row.price }}</td><td>{{ row.takes }}</td><td>{{ row.window }}</td><td>{{ row.valid }}</td>
            </tr>
          </tbody>
        </table>
      </div>
      <button v-if="rows.length > most" type="button" class="somrs-link" @click="most = Infinity">Show {{ rows.length - most }} more</button>
    </div>`,
  props: { rows: Array },
  data() {
    return { most: MOST };
  },
  computed: {
    steps() {
      const found = new Map();
      for (const row of this.rows.slice(0, this.most)) {
        if (!found.has(row.step)) found.set(row.step, { name: row.step, rows: [] });
        found.get(row.step).rows.push(row);
      }
      return [...found.values()];
    },
  },
};
